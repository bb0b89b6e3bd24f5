"""The face model: geometry, muscles and markers as one labelled dataset."""
