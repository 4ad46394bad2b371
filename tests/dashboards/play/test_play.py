"""Agents that act: small films of tasks that render, and a sentence for those that do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dashboards.play.film import check_suffix, write
from dashboards.play.play import play
from orchestrator.execution.actors import Actor
from trainables.delta.exact import exact_q
from trainables.errors import InputError
from trainables.tasks.registry import parse_task


def frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as film:
        return [np.asarray((film.seek(i), film.convert("RGB"))[1]) for i in range(film.n_frames)]


def right(_: object) -> int:
    return 3


def test_the_gridworld_draws_wind_path_and_delta(tmp_path: Path) -> None:
    best = exact_q("windy_gridworld", 0.99).argmax(axis=1)
    delta = np.zeros(400)
    delta[399] = 5.0
    actors = [Actor("best", lambda state: int(best[state]), delta), Actor("right", right)]
    episodes, images = play(parse_task("windy_gridworld"), actors, seed=0)
    assert episodes[0].terminated
    assert (episodes[1].terminated, episodes[1].steps, episodes[1].returns[-1]) == (False, 200, -200.0)
    assert episodes[0].states[0] == 3 * 20
    assert episodes[0].states[-1] == 17 * 20 + 14
    every = list(images)
    assert len(every) == 201
    assert (every[0] != every[-1]).any()
    write(iter(every), tmp_path / "grid.png")
    assert (frames(tmp_path / "grid.png")[0] == every[-1]).all()


@pytest.mark.parametrize(
    "task",
    [
        "cartpole:gravity=5x",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("acrobot", "lunar_lander", "reacher")),
    ],
)
def test_a_task_that_renders_is_filmed_beside_its_source(task: str, tmp_path: Path) -> None:
    actors = [Actor("left", lambda _: 0), Actor("right", lambda _: 1)]
    episodes, images = play(parse_task(task), actors, seed=0)
    path = tmp_path / "film.gif"
    write(images, path)
    film = frames(path)
    assert film[0].shape[1] == 812
    assert len(film) > 3
    assert all(episode.steps >= 5 for episode in episodes)


@pytest.mark.slow
def test_a_long_episode_is_shown_in_larger_steps_up_to_its_end() -> None:
    episodes, images = play(parse_task("acrobot"), [Actor("idle", lambda _: 1)], seed=0)
    assert episodes[0].steps == 500
    assert episodes[0].stride > 1
    assert 80 <= len(list(images)) <= 165


def test_what_does_not_render_is_refused_in_a_sentence() -> None:
    with pytest.raises(InputError, match=r"supply_chain cannot be played: it has no picture"):
        play(parse_task("supply_chain"), [Actor("none", lambda _: 0)], seed=0)


def test_a_file_of_another_kind_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"a film is a \.gif"):
        check_suffix(tmp_path / "film.avi")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="needs ffmpeg"):
        check_suffix(tmp_path / "film.mp4")
