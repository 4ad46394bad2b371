"""The load of the driver's machine in a sweep's run, where MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING asks for it."""

from __future__ import annotations

import logging
from collections.abc import Callable

from mlflow.environment_variables import MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING

log = logging.getLogger("deltatune.tracking")


def watch(uri: str, run_id: str) -> Callable[[], None]:
    """Log processor, memory, disk and network of this machine to a run, and return what stops it.

    MLflow samples every MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL seconds. Without psutil a warning says so.
    """
    if not MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING.get():  # type: ignore[no-untyped-call]
        return _nothing
    try:
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor
    except ImportError as error:
        log.warning("no system metrics in MLflow: %s (pip install psutil)", error)
        return _nothing
    monitor = SystemMetricsMonitor(run_id, resume_logging=True, tracking_uri=uri)  # type: ignore[no-untyped-call]
    monitor.start()  # type: ignore[no-untyped-call]
    return monitor.finish


def _nothing() -> None:
    """Stop nothing."""
