"""Environment variables that Ray and MLflow read when they are imported. Those that the user has set stay."""

from __future__ import annotations

import os
from pathlib import Path

SETTINGS = {
    "RAY_AIR_NEW_OUTPUT": "0",
    "RAY_CHDIR_TO_TRIAL_DIR": "0",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_enable_metrics_collection": "0",  # nobody looks at a local Ray's own metrics
    "RAY_prestart_worker_first_driver": "0",  # Tune's actors have an environment of their own, and start anew
    "RAY_enable_worker_prestart": "0",
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_DISABLE_STRICT_METRIC_CHECKING": "1",
    "TUNE_GLOBAL_CHECKPOINT_S": "1000000000",  # a sweep resumes from its records, never from Tune's snapshots
    "TUNE_MAX_PENDING_TRIALS_PG": "64",  # workers that a cluster starts at a time
    "TUNE_PRINT_ALL_TRIAL_ERRORS": "0",
    "TUNE_WARN_EXCESSIVE_EXPERIMENT_CHECKPOINT_SYNC_THRESHOLD_S": "0",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "1",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "1",
    # One thread per worker process: cells run side by side, and the bits of a product must not depend on their number.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}


def prepare(joins_cluster: bool = False) -> None:
    """Set the environment variables, which the workers inherit.

    joins_cluster: whether to join Ray instead of starting it. A head that has this user's token requires it, and Ray's
    client presents the token only in this mode.
    """
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    given = "RAY_AUTH_TOKEN" in os.environ or "RAY_AUTH_TOKEN_PATH" in os.environ
    if joins_cluster and (given or Path("~/.ray/auth_token").expanduser().exists()):
        os.environ.setdefault("RAY_AUTH_MODE", "token")
