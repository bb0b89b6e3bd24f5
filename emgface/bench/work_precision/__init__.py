"""Error against run time: every setting of the solver is one point, every model its own reference."""

from emgface.bench.work_precision.measure import measure, pareto
from emgface.bench.work_precision.models import MODELS, Model
from emgface.bench.work_precision.settings import Setting, settings_of

__all__ = ["MODELS", "Model", "Setting", "measure", "pareto", "settings_of"]
