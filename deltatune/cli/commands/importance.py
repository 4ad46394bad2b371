"""The command that says which hyperparameters matter."""

from __future__ import annotations

from collections.abc import Sequence

from deltatune.cli.app import RESULT_PANEL, RESULTS, Json, Storage, Sweep, app, findings_of, out, print_json


@app.command(rich_help_panel=RESULT_PANEL)
def importance(name: Sweep, storage: Storage = RESULTS, as_json: Json = False) -> None:
    """Show how much each hyperparameter matters, where a sweep has searched ranges (fANOVA).

    A share is that of the variance of the mean AUC over the ranges. 'deltatune report' draws it, with the AUC at each
    value that was tried.
    """
    findings = findings_of(storage, name)
    from deltatune.cli.sheet import table
    from orchestrator.analysis.importance import MIN_CONFIGURATIONS, importances

    found = importances(findings)
    if as_json:
        print_json([one.key._asdict() | {"configurations": one.configurations, "shares": one.shares} for one in found])
        return
    if not found:
        out.print(
            f"Nothing to show: no agent of {name} has varied two hyperparameters, one of them over a range, in "
            f"{MIN_CONFIGURATIONS} or more configurations with every seed done.",
            soft_wrap=True,
        )
        return
    rows = [
        (one.key.task, one.key.agent, one.source_label, str(one.configurations), parameter, f"{100 * share:.0f}%")
        for one in found
        for parameter, share in one.shares.items()
    ]
    head = ("task", "agent", "source", "configurations", "hyperparameter", "importance")
    out.print(table(head, _once(rows)))


def _once(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the rows with what repeats the row above left out."""
    return [
        row if at == 0 or row[:4] != rows[at - 1][:4] else ("", "", "", "", *row[4:]) for at, row in enumerate(rows)
    ]
