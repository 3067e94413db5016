"""Pages to open in a browser: one static file each, no server, no network."""
