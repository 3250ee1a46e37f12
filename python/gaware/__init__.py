"""Flight-test analysis of ArduPilot and PX4 logs: gyro g-sensitivity and unmodelled sensor errors.

>>> flight = gaware.replay("flight.tlog")
>>> flight.summary["estimate"]["g_sensitivity_deg_per_h_per_g"]
>>> flight.states.to_polars()
>>> found = gaware.explain(["flight.tlog"])
>>> found.verdict, found.model.to_toml()

The same library as the program "gaware"; results are those of its --json and --export.
"""

from . import fleet
from ._gaware import (
    Explanation,
    Flight,
    GawareError,
    LogError,
    Model,
    ModelError,
    Table,
    __version__,
    explain as _explain,
    replay,
)

__all__ = [
    "Explanation",
    "Flight",
    "GawareError",
    "LogError",
    "Model",
    "ModelError",
    "Table",
    "__version__",
    "explain",
    "fleet",
    "replay",
]


def explain(paths, model=None, *, validate=(), parameters=None, source=None, vehicle=None):
    """Identify unmodelled sensor errors in flights of one vehicle, as "gaware explain" does.

    paths: a log or several. validate: logs that are excluded from fitting. parameters: a parameter file of the vehicle.
    """
    paths = [paths] if isinstance(paths, (str, bytes)) or hasattr(paths, "__fspath__") else list(paths)
    return _explain(
        paths, model, validate=list(validate), parameters=parameters, source=source, vehicle=vehicle
    )
