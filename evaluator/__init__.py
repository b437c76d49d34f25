"""Video → marks → pose → turning → comparison → discrepancy → report; the command line."""
