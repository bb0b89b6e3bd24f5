"""Recordings of volunteers: read, labelled, synchronised, cut into trials and checked."""
