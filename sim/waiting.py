"""Passive waiting of the threads of linear algebra.

Spinning threads increase the processor time if other programs run: 25 times for small dense
matrices with six busy processes. Libraries read these variables when they are loaded; values set by
the user are not changed.
"""

import os

PASSIVE = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0", "OPENBLAS_THREAD_TIMEOUT": "4"}

for _name, _value in PASSIVE.items():
    os.environ.setdefault(_name, _value)
