"""Experiments on lips, expressions and skin; results in `docs/mechanics` and `docs/contact`."""
