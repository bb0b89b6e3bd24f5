"""A face with a closed wedge."""

import pytest

import emgface as ef
from tests.treatment.plans import wedge


@pytest.fixture(scope="module")
def operated(coarse):
    return ef.treat(coarse, wedge())
