"""HTML pages: written, served, opened in a browser, photographed."""
