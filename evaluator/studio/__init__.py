"""The studio: a local web application for everything that is done by eye. It calls workflow; nothing calls it."""
