"""Experiments on simulated studies, from which one command generates the page `docs/science`."""
