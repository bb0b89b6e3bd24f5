"""Published tongue, if its files are available."""

import pytest

from emgface.anatomy.tongue.published import import_tongue


@pytest.fixture(scope="session")
def published(shared):
    """The published tongue; not to be changed."""
    return import_tongue(shared / "artisynth_models")
