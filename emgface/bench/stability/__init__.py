"""The stability battery: extreme cases, each run with every integrator that should stand it."""

from emgface.bench.stability.battery import run_battery

__all__ = ["run_battery"]
