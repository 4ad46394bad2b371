"""Which store is meant, and that a password is neither taken from where others read it nor shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.tracking.uri import shown, tracking_uri
from trainables.errors import InputError

SECRET = "s3cr@t/x"


@pytest.mark.parametrize(
    "uri", [f"http://user:{SECRET}@host:5000", f"https://{SECRET}@host/mlflow", "HTTP://u:s3cr@host"]
)
@pytest.mark.parametrize("from_environment", [True, False])
def test_a_servers_address_with_credentials_is_refused(
    uri: str, from_environment: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if from_environment:
        monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    with pytest.raises(InputError) as refusal:
        tracking_uri(tmp_path, None if from_environment else uri)
    for name in ("MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD", "MLFLOW_TRACKING_TOKEN"):
        assert name in str(refusal.value)
    assert "s3cr" not in str(refusal.value)


def test_a_databases_password_comes_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    uri = f"postgresql://user:{SECRET}@host/mlflow"
    with pytest.raises(InputError, match="MLFLOW_TRACKING_URI in the environment") as refusal:
        tracking_uri(tmp_path, uri)
    assert "s3cr" not in str(refusal.value)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    assert tracking_uri(tmp_path, None) == uri
    assert shown(uri) == "postgresql://***@host/mlflow"


def test_an_unknown_scheme_is_refused_without_its_password(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must start with sqlite:") as refusal:
        tracking_uri(tmp_path, f"ftp://user:{SECRET}@host")
    assert "s3cr" not in str(refusal.value)


@pytest.mark.parametrize(
    "uri", ["http://127.0.0.1:5000", "sqlite:////a/b@c.db", "postgresql://user@host/x", "databricks"]
)
def test_what_holds_no_password_is_taken_as_it_is(uri: str, tmp_path: Path) -> None:
    assert tracking_uri(tmp_path, uri) == uri
