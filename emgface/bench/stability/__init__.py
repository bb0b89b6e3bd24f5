"""The stability battery: extreme cases, each run with every integrator that should stand it."""

from emgface.bench.stability.battery import run_battery
from emgface.bench.stability.limits import limits

__all__ = ["limits", "run_battery"]
