"""The study: run table, stored stages, retry policy, from recordings to the scored cube.

Called, the package runs a study: `emgface.api.study`.
"""

from emgface._callable import make_callable
from emgface.api import study

make_callable(__name__, study)
del study
