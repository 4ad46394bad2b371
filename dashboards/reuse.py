"""Transfer ratio of direct reuse against max |delta| (Figure 1), learned and exact source side by side."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from dashboards.curves import SOURCES
from dashboards.style import COLOURS, new_figure, save
from orchestrator.aggregates import Group, groups
from orchestrator.results import Results
from trainables.delta.bounds import bounds


def draw(results: Results) -> list[Path]:
    """Draw the figure; no file where fewer than two targets have both direct reuse and the agent without transfer."""
    cells, _ = results.tables()
    reuse = [group for group in groups(cells) if group.agent == "policy_reuse" and _has_ratio(group)]
    sources = [source for source in SOURCES if sum(group.source == source for group in reuse) > 1]
    if not sources:
        return []
    figure = new_figure(4.4 * len(sources) + 0.4, 3.8)
    panels = figure.subplots(1, len(sources), squeeze=False, sharey=True)[0]
    for axes, source in zip(panels, sources, strict=True):
        _panel(axes, [group for group in reuse if group.source == source])
        axes.set_title(SOURCES[source], fontsize=9)
        axes.set_xlabel("max |delta|", labelpad=1)
    panels[0].set_ylabel("transfer ratio of direct reuse (%)")
    figure.suptitle(f"{results.name}: does max |delta| tell whether reuse helps? 95 % intervals", fontsize=10)
    return save(figure, results.folder / "figures", "reuse_against_delta")


def _has_ratio(group: Group) -> bool:
    return group.against_base is not None and group.against_base.transfer_ratio.value is not None


def _panel(axes: Axes, shown: list[Group]) -> None:
    axes.axhline(0, color="#4d4d4d", lw=0.8)
    named: dict[tuple[int, int], list[tuple[float, float, str]]] = {}
    for number, group in enumerate(sorted(shown, key=lambda group: group.task)):
        assert group.against_base is not None
        ratio = group.against_base.transfer_ratio
        assert ratio.value is not None
        low, high = (ratio.low, ratio.high) if ratio.low is not None and ratio.high is not None else (ratio.value,) * 2
        y, error = ratio.value * 100, [[(ratio.value - low) * 100], [(high - ratio.value) * 100]]
        x = group.max_abs_delta.value if group.max_abs_delta else 0.0
        label = "estimated along the reused policy" if number == 0 else None
        axes.errorbar([x], [y], yerr=error, fmt="o", color=COLOURS["policy_reuse"], capsize=2, ms=5, label=label)
        if group.source == "exact" and group.source_task is not None:
            exact = bounds(group.source_task, group.task).max_abs_delta
            axes.plot([x, exact], [y, y], "-", color="#999999", lw=0.8)
            label = "exact, over all states and actions" if number == 0 else None
            axes.plot([exact], [y], "D", mfc="none", color="#4d4d4d", ms=5, label=label)
        named.setdefault((round(x), round(y / 20)), []).append((x, y, _name(group)))
    for near in named.values():
        x, y = near[-1][:2]
        text = ", ".join(name for *_, name in near)
        axes.annotate(text, (x, y), textcoords="offset points", xytext=(6, 7), fontsize=7)
    axes.margins(0.14)
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


def _name(group: Group) -> str:
    """What sets the target apart from the source."""
    return group.task.partition(":")[2].removeprefix("wind=") or "none (the source itself)"
