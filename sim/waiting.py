"""Passive waiting of the threads of linear algebra.

They otherwise wait by spinning, which multiplies the processor time where other programs run: 25 times
for small dense matrices beside six busy processes. Libraries read these variables when they are loaded;
what a user has set stays.
"""

import os

PASSIVE = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0", "OPENBLAS_THREAD_TIMEOUT": "4"}

for _name, _value in PASSIVE.items():
    os.environ.setdefault(_name, _value)
