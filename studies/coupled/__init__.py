"""The seven experiments of the chapter on the coupled model; results in `docs/coupled`."""
