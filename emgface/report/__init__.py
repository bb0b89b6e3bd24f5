"""The report of a study as one page that opens offline, with the moving face in it."""
