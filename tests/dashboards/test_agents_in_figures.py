"""What the figures know of an agent comes from its entry, for custom agents as for built-in ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dashboards import style
from dashboards.draw import draw
from dashboards.figure_model import Chart
from dashboards.figures import delta_effect, gate
from dashboards.style import look
from orchestrator.export.sb3 import dqn_arguments
from tests.dashboards.synthetic import findings
from trainables.agents.registry import AGENTS
from trainables.custom import load

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "fading_advice.py"


def test_custom_agents_are_told_apart_by_colour_and_by_marker_or_dash() -> None:
    custom = [f"mine.py@{number:08x}:Agent" for number in range(4)]
    style.assign(["q_learning", *custom])
    looks = [look(agent) for agent in (*(a.name for a in AGENTS.values() if a.kind == "tabular"), *custom)]
    assert len({each.light for each in looks}) == len({each.dark for each in looks}) == len(looks)
    assert len({(each.dash, each.marker) for each in looks}) == len(looks)
    assert [style.rank(agent) for agent in custom] == sorted(style.rank(agent) for agent in custom)
    assert all(style.key(agent).isidentifier() for agent in custom)


def test_a_threshold_that_was_calibrated_is_drawn_at_its_mean(tmp_path: Path) -> None:
    agents: dict[str, Any] = {"q_learning": {}, "delta_gate": {"threshold": ["auto"]}}
    found = findings(
        tmp_path, 1, 3, 5, agents=agents, grids={"q_learning": [{}], "delta_gate": [{"threshold": "auto"}]}
    )
    figure = gate.chart(found)
    assert isinstance(figure, Chart)
    levels = [level for panel in figure.panels for level in panel.levels]
    assert [(level.value, level.label) for level in levels] == [(4.5, "threshold of delta_gate")]


def test_a_custom_agent_has_every_figure_and_export(tmp_path: Path) -> None:
    """It reports max |delta| and has a transfer ratio, so that it is in the figure of delta against transfer."""
    name = load(f"{EXAMPLE}:Agent")
    agents: dict[str, Any] = {"q_learning": {}, name: {}}
    found = findings(tmp_path, 3, 3, 5, agents=agents, grids={"q_learning": [{}], name: [{}]})
    figure = delta_effect.chart(found)
    assert isinstance(figure, Chart)
    assert {series.agent for panel in figure.panels for series in panel.series} == {name}
    assert dqn_arguments(found)["dqn"] == []
    page = draw(found)[0].read_text()
    assert f"@{style.key(name)}" in page
    assert "@fading_advice" not in page.replace(name, "")
