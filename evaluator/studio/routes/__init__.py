"""Routes of the studio, one file per screen."""
