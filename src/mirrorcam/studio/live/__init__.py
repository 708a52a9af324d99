"""The camera at work in a browser: aim, focus, calibrate, record."""
