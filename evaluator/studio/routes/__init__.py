"""What the browser may ask for, a file a screen."""
