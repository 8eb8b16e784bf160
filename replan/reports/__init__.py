"""Self-contained HTML pages: templates and SVG figures that all reports share."""
