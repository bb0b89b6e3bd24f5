"""From sEMG to muscle activation, one stage per file."""
