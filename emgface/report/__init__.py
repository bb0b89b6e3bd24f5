"""Report of a study as one offline page with the moving face."""
