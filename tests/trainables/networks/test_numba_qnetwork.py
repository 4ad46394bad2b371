"""The hand-written learner is held to torch's autograd and Adam."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
import torch

from trainables.agents.builtin.dqn import DQN
from trainables.errors import InputError
from trainables.networks.adam import adam
from trainables.networks.numba_qnetwork import QNetwork
from trainables.networks.torch_qnetwork import TorchNetwork


def network(sizes: tuple[int, ...] = (4, 64, 64, 2), batch: int = 64, **options: float | bool) -> QNetwork:
    return QNetwork(sizes, batch, 1e-3, generator=torch.Generator().manual_seed(3), **options)


@pytest.mark.parametrize("huber", [False, True])
@pytest.mark.parametrize("max_norm", [1e9, 0.05], ids=["free", "clipped"])
@pytest.mark.parametrize(("sizes", "batch"), [((4, 64, 64, 2), 64), ((6, 50, 33, 9), 37), ((3, 20, 4), 5)])
def test_parameters_after_100_updates_are_torchs(
    sizes: tuple[int, ...], batch: int, max_norm: float, huber: bool
) -> None:
    ours = network(sizes, batch, max_gradient_norm=max_norm, huber=huber)
    module = network(sizes, batch).as_module()
    optimiser = torch.optim.Adam(module.parameters(), 1e-3)
    criterion = torch.nn.functional.smooth_l1_loss if huber else torch.nn.functional.mse_loss
    rng, clipped = np.random.default_rng(0), 0
    for _ in range(100):
        x = rng.standard_normal((batch, sizes[0])).astype(np.float32)
        actions, targets = rng.integers(0, sizes[-1], batch), (3 * rng.standard_normal(batch)).astype(np.float32)
        q = module(torch.from_numpy(x)).gather(1, torch.from_numpy(actions)[:, None])[:, 0]
        loss = criterion(q, torch.from_numpy(targets))
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        clipped += int(float(torch.nn.utils.clip_grad_norm_(module.parameters(), max_norm)) > max_norm)
        optimiser.step()
        assert ours.update(np.ascontiguousarray(x.T).ravel(), actions, targets) == pytest.approx(
            float(loss.detach()), rel=1e-5
        )
    assert clipped == (100 if max_norm < 1 else 0)
    theirs = torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy()
    assert np.abs(ours.parameters - theirs).max() < 1e-6


def test_as_module_shares_memory_both_ways() -> None:
    ours = network()
    module = ours.as_module()
    x = np.random.default_rng(0).standard_normal((7, 4)).astype(np.float32)
    with torch.no_grad():
        np.testing.assert_allclose(ours.rows(x), module(torch.from_numpy(x)).numpy(), atol=1e-6)
        next(module.parameters()).zero_()
    assert not ours.parameters[: 64 * 4].any()
    ours.update(x[:1].repeat(64, 0).T.ravel().copy(), np.zeros(64, np.int64), np.ones(64, np.float32))
    with torch.no_grad():
        np.testing.assert_allclose(ours.rows(x), module(torch.from_numpy(x)).numpy(), atol=1e-6)


def test_a_state_dict_goes_out_and_comes_in() -> None:
    ours, other = network(), QNetwork((4, 64, 64, 2), 64, 1e-3)
    other.load_state_dict(ours.state_dict())
    np.testing.assert_array_equal(other.parameters, ours.parameters)
    with pytest.raises(RuntimeError, match="size mismatch"):
        QNetwork((4, 32, 32, 2), 64, 1e-3).load_state_dict(ours.state_dict())


def test_initial_weights_are_xavier_and_depend_on_the_generator_alone() -> None:
    ours = network()
    np.testing.assert_array_equal(ours.parameters, network().parameters)
    for module in ours.as_module():
        if isinstance(module, torch.nn.Linear):
            bound = (6 / sum(module.weight.shape)) ** 0.5
            assert 0.8 * bound < float(module.weight.detach().abs().max()) <= bound
            assert not module.bias.detach().any()


def test_one_row_and_many_agree_and_many_do_not_depend_on_each_other() -> None:
    ours = network((8, 256, 256, 4), 128)
    x = np.random.default_rng(0).standard_normal((300, 8)).astype(np.float32)
    rows = ours.rows(x)
    for i in (0, 128, 299):
        np.testing.assert_allclose(ours.row(x[i]), rows[i], atol=1e-5)
        np.testing.assert_array_equal(ours.rows(x[i : i + 1])[0], rows[i])


def test_a_nan_is_not_hidden_by_the_relu() -> None:
    ours = network()
    x = np.full((2, 4), np.nan, np.float32)
    assert np.isnan(ours.rows(x)).all()
    assert np.isnan(ours.row(x[0])).all()


def test_the_torch_path_learns_the_same() -> None:
    settings = DQN(hidden_size=32, batch_size=16)
    generator = torch.Generator().manual_seed(3)
    theirs = TorchNetwork(settings, 4, 2, 1e-3, generator, (32, 32))
    assert theirs.sizes.tolist() == [4, 32, 32, 2]
    ours = QNetwork((4, 32, 32, 2), 16, 1e-3, generator=torch.Generator().manual_seed(3))
    np.testing.assert_array_equal(theirs.vector(), ours.vector())
    rng = np.random.default_rng(0)
    for _ in range(30):
        x, actions = rng.standard_normal(4 * 16).astype(np.float32), rng.integers(0, 2, 16)
        targets = rng.standard_normal(16).astype(np.float32)
        assert theirs.update(x, actions, targets) == pytest.approx(ours.update(x, actions, targets), rel=1e-4)
    assert np.abs(theirs.vector() - ours.vector()).max() < 1e-6


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_distillation_is_torchs(loss: Literal["squared", "huber"]) -> None:
    """The gradient written by hand, of both losses, is autograd's, and weight 0 is the plain update."""
    settings = DQN(device="cpu", loss=loss, batch_size=16)
    ours, plain = (network((4, 32, 32, 3), 16, huber=loss == "huber") for _ in range(2))
    theirs = TorchNetwork(settings, 4, 3, 1e-3, torch.Generator(), (32, 32))
    theirs.load_vector(ours.vector())
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, targets = rng.normal(size=4 * 16).astype(np.float32), rng.normal(size=16).astype(np.float32)
        actions, teacher = rng.integers(3, size=16), rng.normal(size=(16, 3)).astype(np.float32)
        losses = [each.distil(x, actions, targets, teacher, 2.0, 0.5) for each in (ours, theirs)]
        assert losses[0] == pytest.approx(losses[1], rel=1e-4)
    np.testing.assert_allclose(ours.vector(), theirs.vector(), atol=1e-4)
    other = network((4, 32, 32, 3), 16, huber=loss == "huber")
    plain.update(x, actions, targets)
    other.distil(x, actions, targets, teacher, 0.0, 0.5)
    np.testing.assert_array_equal(plain.vector(), other.vector())


@pytest.mark.parametrize("name", ["nowhere:f", "math:nothing", "nonsense"])
def test_a_wrong_module_factory_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="module:factory"):
        TorchNetwork(DQN(module=name), 4, 2, 1e-3, None)


@pytest.mark.parametrize(
    "dead", [(slice(0, 5), slice(3, 40)), (slice(0, 0), slice(0, 50)), (slice(0, 50), slice(1, 2))]
)
def test_units_that_are_dead_for_a_minibatch_are_left_out_and_torch_sees_no_difference(
    dead: tuple[slice, slice],
) -> None:
    ours = network((6, 50, 50, 3), 32)
    module = network((6, 50, 50, 3), 32).as_module()
    optimiser = torch.optim.Adam(module.parameters(), 1e-3)
    rng = np.random.default_rng(0)
    for i in range(60):
        if i in (20, 40):  # dead, and alive again
            for either in (module, ours.as_module()):
                for layer, units in zip((0, 2), dead, strict=True):
                    with torch.no_grad():
                        either[layer].bias[units] = -100.0 if i == 20 else 0.1
        x = rng.standard_normal((32, 6)).astype(np.float32)
        actions, targets = rng.integers(0, 3, 32), rng.standard_normal(32).astype(np.float32)
        q = module(torch.from_numpy(x)).gather(1, torch.from_numpy(actions)[:, None])[:, 0]
        optimiser.zero_grad()
        torch.autograd.backward(torch.nn.functional.mse_loss(q, torch.from_numpy(targets)))
        torch.nn.utils.clip_grad_norm_(module.parameters(), 10.0)
        optimiser.step()
        ours.update(np.ascontiguousarray(x.T).ravel(), actions, targets)
    theirs = torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy()
    assert np.abs(ours.parameters - theirs).max() < 1e-5


def test_moments_that_decay_below_the_smallest_normal_number_become_0_and_change_no_parameter() -> None:
    count, tiny = 37, np.finfo(np.float32).tiny
    parameters = np.random.default_rng(0).standard_normal(count).astype(np.float32)
    first, second = np.full(count, 1.05 * tiny, np.float32), np.full(count, 1.0005 * tiny, np.float32)
    first[3] = second[3] = 1.0
    before = parameters.copy()
    adam(parameters, first, second, np.zeros(count, np.float32), 5, 1e-3, 10.0)
    others = np.arange(count) != 3
    assert not first[others].any()
    assert not second[others].any()
    np.testing.assert_array_equal(parameters[others], before[others])
    assert first[3] == np.float32(0.9)
    assert parameters[3] != before[3]
    first[5] = np.nan
    adam(parameters, first, second, np.zeros(count, np.float32), 6, 1e-3, 10.0)
    assert np.isnan(first[5])
    assert np.isnan(parameters[5])
