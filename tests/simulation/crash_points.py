"""Every crash point of a tiny sweep: a death before each step, and each legal loss of what was not synchronised."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.simulation.files import Handle
from tests.simulation.simulate import User, check, folder_for, in_virtual_time, undisturbed
from tests.simulation.world import World


@dataclass
class Script:
    """Makes the choices of a list, then the first of all; `sizes` says how many there were each time."""

    choices: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)

    def __call__(self, options: Sequence[Any]) -> Any:
        self.sizes.append(len(options))
        at = len(self.sizes) - 1
        return options[self.choices[at] if at < len(self.choices) else 0]

    def next(self) -> Script | None:
        """Return the next script in order; None after the last."""
        made = [*self.choices, *[0] * (len(self.sizes) - len(self.choices))]
        while made:
            if made[-1] + 1 < self.sizes[len(made) - 1]:
                made[-1] += 1
                return Script(made)
            made.pop()
        return None


def crash(at: int, how: str, script: Script) -> tuple[bool, list[str]]:
    """Let a driver die before step `at`, and another go on: (whether the first came so far, what is wrong then).

    how: 'kill' (what was handed to the system stays), 'torn' (it dies in the middle of a write) or 'power loss'.
    """
    undisturbed(tiny=True)
    world = World(0, {})
    with folder_for(True, at) as storage, in_virtual_time(world, storage) as (files, store):
        user, struck = User(world, storage, files, store, tiny=True), []

        def harm(step: int, what: str, handle: Handle | None, data: bytes) -> None:
            if step != at or (how == "torn" and handle is None):
                return
            struck.append(step)
            files.harm = None
            if how == "torn" and handle is not None:
                files.extend_live(handle, data[: len(data) // 2])
            if how == "power loss":
                files.lose_power(script)
            world.die()

        def two_lives() -> None:
            files.harm = harm
            user.life("here")
            files.harm = None
            user.finish()

        world.spawn(two_lives, None)
        world.go()
        check(world, storage, store, tiny=True)
    return bool(struck), world.violations


def steps() -> int:
    """Return how many steps the sweep takes without harm."""
    world = World(0, {})
    with folder_for(True, 0) as storage, in_virtual_time(world, storage) as (files, store):
        user = User(world, storage, files, store, tiny=True)
        world.spawn(lambda: user.life("here") and None, None)
        world.go()
        return files.steps


def every() -> Iterator[tuple[str, list[str]]]:
    """Yield (which crash, what is wrong after it) of all of them."""
    for at in range(1, steps() + 1):
        for how in ("kill", "torn"):
            struck, wrong = crash(at, how, Script())
            if struck:
                yield f"{how} before step {at}", wrong
        script: Script | None = Script()
        while script is not None:
            _, wrong = crash(at, "power loss", script)
            yield f"power loss before step {at}, {script.choices}", wrong
            script = script.next()
