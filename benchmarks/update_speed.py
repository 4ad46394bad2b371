"""The update of the deep agents compared with the limits of this core: its multiply-add units, and its BLAS library.

    python -m benchmarks.update_speed --json

One thread, CPU time. A figure is the median of turns in which all rows alternate, so that noise affects them alike.
`dead` is the share of the last hidden layer's units that no sample of the minibatch activates. The update skips them,
so its rate, which counts the arithmetic of the whole network, may exceed the peak.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types

from trainables.networks import mlp
from trainables.networks.adam import adam
from trainables.networks.workspace import aligned, parameter_count, workspace
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32
from trainables.numerics.simd import WIDTH, WORD, intrinsic, load, loop, pointer, store, vector_fma
from trainables.numerics.threads import one_thread

SHAPES = {"cartpole": ((4, 64, 64, 2), 64), "acrobot": ((6, 256, 256, 3), 128), "lunar_lander": ((8, 256, 256, 4), 128)}
"""Layers and batch of Table 6."""

DEAD = (0.0, 0.25)
CHAINS = 12
"""Independent sums: enough to hide the latency of a multiply-add, and few enough for the registers of any machine."""


@intrinsic
def _multiply_adds(typing: Any, count: Any, c: Any) -> Any:
    """Do `count` fused multiply-adds in each of CHAINS vectors."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        count, c = args
        vector = ir.VectorType(ir.FloatType(), WORD)
        fma, at = (
            vector_fma(builder, vector),
            pointer(context, builder, signature.args[1], c, ir.Constant(count.type, 0)),
        )
        places = [builder.gep(at, [ir.Constant(count.type, i * WORD)]) for i in range(CHAINS)]
        x = load(builder, at, vector)
        sums = loop(
            builder,
            count,
            [load(builder, place, vector) for place in places],
            lambda index, carried: [builder.call(fma, [x, x, total]) for total in carried],
        )
        for place, total in zip(places, sums, strict=True):
            store(builder, total, place)
        return context.get_dummy_value()

    return types.void(types.intp, c), codegen


@compiled
def _peak(count: int, c: F32) -> None:
    _multiply_adds(count, c)


Work = tuple[Callable[[], object], float]
"""A call, and its number of floating-point operations."""


def _peaks() -> dict[str, Work]:
    count, c = 100_000, aligned(CHAINS * WORD)
    rng = np.random.default_rng(0)
    a, out = rng.standard_normal((512, 512)).astype(np.float32), np.empty((512, 512), np.float32)
    return {
        "fma_peak": (lambda: _peak(count, c), 2.0 * count * CHAINS * WORD),
        "sgemm": (lambda: np.matmul(a, a, out=out), 2.0 * 512**3),
    }


def _update(sizes: tuple[int, ...], batch: int, dead: float) -> tuple[Work, Work]:
    """Return an update that changes no parameter, and its Adam step alone."""
    rng, layers, work = np.random.default_rng(0), np.array(sizes), workspace(np.array(sizes), batch)
    count = parameter_count(layers)
    parameters, first, second = (aligned(count) for _ in range(3))
    at = 0
    for layer, (n_in, n_out) in enumerate(itertools.pairwise(sizes)):
        parameters[at : at + n_in * n_out] = rng.uniform(-1, 1, n_in * n_out) * (6 / (n_in + n_out)) ** 0.5
        at += n_in * n_out
        if layer == len(sizes) - 3:
            parameters[at : at + round(dead * n_out)] = -1e3
        at += n_out
    x, actions = rng.standard_normal(sizes[0] * batch).astype(np.float32), rng.integers(0, sizes[-1], batch)
    targets = rng.standard_normal(batch).astype(np.float32)
    state = layers, parameters, first, second

    def whole() -> object:
        return mlp.update(*state, work, x, actions, targets, 5, 0.0, 10.0, False)

    def step() -> object:
        return adam(parameters, first, second, work.gradient, 5, 0.0, 10.0)

    products = sum(n_in * n_out for n_in, n_out in itertools.pairwise(sizes))
    return (whole, 2.0 * batch * (3 * products - sizes[0] * sizes[1])), (step, 0.0)


def measure(seconds: float, turns: int = 9) -> dict[str, Any]:
    """Return the figures of all rows, from `seconds` of CPU time for each."""
    rows = _peaks()
    for task, (sizes, batch) in SHAPES.items():
        for dead in DEAD:
            rows[f"{task}, dead {dead:g}"], step = _update(sizes, batch, dead)
            if not dead:
                rows[f"{task}, adam alone"] = step
    counts = {name: _count(call, seconds / turns) for name, (call, _) in rows.items()}
    times: dict[str, list[float]] = {name: [] for name in rows}
    for _ in range(turns):
        for name, (call, _) in rows.items():
            start = time.thread_time()
            for _ in range(counts[name]):
                call()
            times[name].append((time.thread_time() - start) / counts[name])
    peak = rows["fma_peak"][1]
    result: dict[str, Any] = {"lanes": WORD, "panel": WIDTH}
    for name, (_, operations) in rows.items():
        middle = statistics.median(times[name])
        result[name] = {"us": round(middle * 1e6, 2)}
        if operations:
            share = statistics.median(
                operations / spent / (peak / best) for spent, best in zip(times[name], times["fma_peak"], strict=True)
            )
            result[name] |= {"gflops": round(operations / middle / 1e9, 1), "share_of_peak": round(share, 3)}
    return result


def _count(call: Callable[[], object], seconds: float) -> int:
    call()
    start = time.thread_time()
    for _ in range(3):
        call()
    return max(1, int(3 * seconds / max(time.thread_time() - start, 1e-6)))


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=0.5, help="CPU seconds for each row")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    one_thread()
    result = measure(arguments.seconds)
    if arguments.json:
        print(json.dumps(result, indent=2))
        return
    print(f"vectors of {result['lanes']} floats\n{'':28}{'us':>10}{'GFLOP/s':>10}{'of peak':>10}")
    for name, row in result.items():
        if isinstance(row, dict):
            rate = f"{row['gflops']:10.1f}{row['share_of_peak']:10.0%}" if "gflops" in row else ""
            print(f"{name:28}{row['us']:10.1f}{rate}")


if __name__ == "__main__":
    main()
