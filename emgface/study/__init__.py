"""The study: run table, stored stages, retry policy, from recordings to the scored cube."""
