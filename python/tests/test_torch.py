"""palpate.torch: gradients by gradcheck in double, against the measurement, and the tensors' types."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import CUBE_TRIANGLES, CUBE_VERTICES, pose_matrix

import palpate

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from palpate import _core  # noqa: E402
from palpate.torch import _place_of, _spheres, clearance, penetration, wrench  # noqa: E402

STANDS = [0.3, -0.2, 0.5, 0.1, 0.7, -0.3, 0.6]


@pytest.fixture(scope="module", params=["camera", "world"])
def felt(request):
    """A surface with edges, and poses in it whose quaternions are not of unit length."""
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth, pose=STANDS if request.param == "world" else None)
    random = np.random.default_rng(5)
    pixels = [(60, 70), (50, 90), (70, 80)]
    poses = [[*surface.points[v, u], *random.normal(size=4) * 1.3] for v, u in pixels]
    return surface, torch.tensor(np.array(poses, np.float64), requires_grad=True)


@pytest.fixture(scope="module")
def apart():
    """A cube whose center of mass is not the origin of T."""
    return palpate.pack(CUBE_VERTICES + [0.02, 0.01, -0.03], CUBE_TRIANGLES, 60)


def scaled(tool, surface):
    """Volume and potential scaled to about one, to suit gradcheck's tolerances."""
    def numbers(poses):
        volume, potential = penetration(tool, surface, poses)
        return volume / tool.volume, potential / (tool.volume * 0.01)

    return numbers


def test_the_numbers_are_those_of_the_measurement(cube, felt):
    surface, poses = felt
    contact = palpate.Contact(cube)
    volume, potential = penetration(cube, surface, poses)
    felt_wrench = wrench(cube, surface, poses)
    for k, pose in enumerate(poses.detach().numpy()):
        result = contact.measure(surface, pose)
        assert volume[k].item() == pytest.approx(result.volume, rel=1e-4)
        assert potential[k].item() == pytest.approx(result.potential, rel=1e-3)
        assert felt_wrench[k, :3].numpy(force=True) == pytest.approx(result.force, abs=1e-4 * result.volume)


def test_gradcheck(cube, felt):
    surface, poses = felt
    assert torch.autograd.gradcheck(scaled(cube, surface), (poses,), eps=1e-7, atol=1e-4, rtol=1e-3)


def test_gradcheck_of_the_wrench(cube, felt):
    surface, poses = felt

    def numbers(given):
        return wrench(cube, surface, given) / (cube.volume * torch.tensor([1, 1, 1, .01, .01, .01]))

    assert torch.autograd.gradcheck(numbers, (poses,), eps=1e-8, atol=1e-2, rtol=1e-2)


def test_the_gradient_of_the_potential_is_the_wrench(cube, felt):
    surface, poses = felt
    (gradient,) = torch.autograd.grad(penetration(cube, surface, poses).potential.sum(), poses)
    expected = -wrench(cube, surface, poses)[:, :3]
    assert torch.allclose(gradient[:, :3], expected.to(gradient), rtol=1e-12)


def test_the_second_derivative_of_the_potential_is_the_stiffness(cube, felt):
    surface, poses = felt
    contact = palpate.Contact(cube)
    K = contact.measure(surface, poses[0].detach().numpy(), stiffness=True).stiffness
    one = poses[:1].detach().requires_grad_()
    hessian = torch.autograd.functional.hessian(
        lambda given: penetration(cube, surface, given).potential.sum(), one)[0, :3, 0, :3]
    assert hessian.numpy() == pytest.approx(K[:3, :3], abs=1e-3 * np.abs(K[:3, :3]).max())


def test_matrices_go_down_to_where_the_tool_is_free(cube, felt):
    """(P, 4, 4): a few steps along the gradient lower the potential."""
    surface, poses = felt
    X = torch.tensor(np.array([pose_matrix(p) for p in poses.detach().numpy()]), requires_grad=True)
    before = penetration(cube, surface, X)
    assert torch.allclose(before.volume, penetration(cube, surface, poses).volume, rtol=1e-6)
    (gradient,) = torch.autograd.grad(before.potential.sum(), X)
    # Along rotations: turn about the tool's origin by a small vector.
    step = 1e-6
    for k in range(3):
        axis = np.zeros(3)
        axis[k] = step / 2
        turn = torch.tensor(pose_matrix([0, 0, 0, *axis, 1]))
        there = X.detach().clone()
        there[:, :3, :3] = turn[:3, :3] @ there[:, :3, :3]
        change = (penetration(cube, surface, there).potential - before.potential).detach()
        predicted = (gradient * (there - X.detach())).sum((1, 2))
        assert torch.allclose(change, predicted, atol=2e-2 * float(predicted.abs().max()))


def test_single_precision_and_bad_poses(cube, felt):
    surface, poses = felt
    single = poses.detach().float().requires_grad_()
    volume = penetration(cube, surface, single).volume
    assert volume.dtype == torch.float32
    volume.sum().backward()
    assert single.grad.dtype == torch.float32 and torch.isfinite(single.grad).all()
    (first,) = torch.autograd.grad(penetration(cube, surface, single).potential.sum(), single, create_graph=True)
    (second,) = torch.autograd.grad(first.sum(), single)
    assert second.dtype == torch.float32 and torch.isfinite(second).all() and second.any()
    with pytest.raises(ValueError, match=r"poses: shape \(3, 6\)"):
        penetration(cube, surface, poses[:, :6])
    for other in (torch.int64, torch.float16):
        with pytest.raises(ValueError, match="numbers of type .* are not taken; give float64"):
            wrench(cube, surface, torch.zeros(2, 7, dtype=other))
    with pytest.raises(ValueError, match="not finite"):
        penetration(cube, surface, torch.full((1, 7), float("nan"), dtype=torch.float64))


def test_one_scene_has_no_numbers(cube, felt):
    surface, poses = felt
    with pytest.raises(ValueError, match="surface_of_pose: there is one scene"):
        penetration(cube, surface, poses, surface_of_pose=torch.zeros(3, dtype=torch.int32))


def test_tensors_are_images_and_poses(cube, felt):
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    by_numpy = palpate.Sensor(camera).update(depth)
    by_torch = palpate.Sensor(camera).update(torch.from_numpy(depth))
    assert np.array_equal(by_numpy.points, by_torch.points, equal_nan=True)
    pose = [*by_numpy.points[60, 70], 0, 0, 0, 1.0]
    contact = palpate.Contact(cube)
    a, b = contact.measure(by_numpy, pose), contact.measure(by_numpy, torch.tensor(pose, dtype=torch.float64))
    assert a.volume == b.volume > 0
    assert torch.from_dlpack(by_numpy.points).shape == (120, 160, 3)


def test_gradcheck_of_the_clearance(cube, apart):
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth)
    pose = [*(surface.points[60, 40] - [0, 0, 0.06]), 0.1, 0.9, -0.2, 0.4]
    poses = torch.tensor(np.array([pose], np.float64), requires_grad=True)
    value = clearance(cube, surface, poses)
    assert 0 < value.item() < 0.1
    assert torch.autograd.gradcheck(lambda p: clearance(cube, surface, p), (poses,), eps=1e-7, atol=1e-5)
    assert torch.autograd.gradgradcheck(lambda p: clearance(cube, surface, p), (poses,), eps=1e-6, atol=1e-4)
    assert torch.autograd.gradgradcheck(lambda p: clearance(apart, surface, p), (poses,), eps=1e-6, atol=1e-4)
    X = torch.tensor(np.array([pose_matrix(pose)]), requires_grad=True)
    assert clearance(cube, surface, X).item() == pytest.approx(value.item(), rel=1e-9)
    (gradient,) = torch.autograd.grad(clearance(cube, surface, X), X)
    by_pose = palpate.Contact(cube).measure_batch(surface, [pose], clearance=True).clearance_gradient[0]
    assert gradient[0, :3, 3].numpy() == pytest.approx(by_pose[:3], abs=1e-12)


def test_scenes_with_bodies_have_exact_gradients(cube):
    depth, camera, _ = palpate.render_scene("wall", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth)
    body = palpate.Body(cube, [0.05, 0, 0.7, 0, 0, 0, 1])
    scene = palpate.Scene([surface], [body])
    contact = palpate.Contact(cube)
    poses = torch.tensor([[0.03, 0.01, 0.69, 0.1, 0.2, -0.1, 0.9]], dtype=torch.float64, requires_grad=True)
    found = penetration(contact, scene, poses)
    (gradient,) = torch.autograd.grad(found.potential.sum(), poses)
    batch = contact.measure_batch(scene, poses.detach().numpy())
    assert batch.volume[0] > 0
    assert gradient[0, :3].numpy() == pytest.approx(-batch.force[0], rel=1e-12)
    assert not found.volume.requires_grad
    alone = penetration(contact, palpate.Scene([surface]), poses)
    assert alone.volume.requires_grad


def test_matrices_are_made_poses():
    """Turns of all kinds: small ones, half turns about each axis, and any."""
    random = np.random.default_rng(8)
    quaternions = [*np.eye(4), *(np.eye(4) + 1e-9), *random.normal(size=(50, 4))]
    X = torch.tensor(np.array([pose_matrix([*random.normal(size=3), *q]) for q in quaternions]))

    def plain(poses):
        numbers = torch.empty(len(poses), 7, dtype=torch.float64)
        _core.plain_poses(poses, numbers)
        return numbers

    for seven, matrix in zip(plain(X).numpy(), X.numpy()):
        assert pose_matrix(seven) == pytest.approx(matrix, abs=1e-14)
    assert torch.equal(plain(plain(X)), plain(X)) and torch.allclose(plain(X.float()), plain(X), atol=1e-6)
    others = torch.stack([torch.zeros(4, 4), 2 * torch.eye(4), torch.ones(4, 4)]).double()
    assert plain(others)[:, 3].isnan().all(), "what is no rotation is no pose"


def matrices_of(sevens):
    """(P, 4, 4) of (P, 7), differentiable."""
    x, y, z, w = (sevens[:, 3:] / sevens[:, 3:].norm(dim=1, keepdim=True)).unbind(1)
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    R = torch.stack([torch.stack(row, 1) for row in rows], 1)
    top = torch.cat([R, sevens[:, :3, None]], 2)
    return torch.cat([top, torch.tensor([0, 0, 0, 1.0]).to(top).expand(len(top), 1, 4)], 1)


def test_both_kinds_of_poses_have_the_same_derivatives(cube, felt):
    surface, poses = felt
    random = np.random.default_rng(3)
    direction = torch.tensor(random.normal(size=poses.shape))
    weight = torch.tensor(random.uniform(0.5, 1.5, len(poses)))

    def derivatives(function):
        value = function(poses) * weight
        (first,) = torch.autograd.grad(value.sum(), poses, create_graph=True)
        (second,) = torch.autograd.grad((first * direction).sum(), poses)
        return value.detach(), first.detach(), second

    for question in (lambda p: penetration(cube, surface, p).potential, lambda p: clearance(cube, surface, p, limit=0.5)):
        here, there = derivatives(question), derivatives(lambda p: question(matrices_of(p)))
        for one, other in zip(here, there):
            assert one.abs().max() > 0 and torch.allclose(one, other, rtol=1e-9, atol=1e-9 * float(one.abs().max()))


def test_gradgradcheck_of_the_potential(apart, felt):
    surface, poses = felt
    scale = torch.tensor([1.3, 0.7, 0.9], dtype=torch.float64, requires_grad=True)

    def numbers(given, by):
        return by * penetration(apart, surface, given).potential / (apart.volume * 0.01)

    assert torch.autograd.gradgradcheck(numbers, (poses, scale), eps=1e-8, atol=1e-2, rtol=1e-2)


def test_a_volume_has_no_second_derivative(cube, felt):
    surface, poses = felt
    (gradient,) = torch.autograd.grad(penetration(cube, surface, poses).volume.sum(), poses, create_graph=True)
    with pytest.raises(RuntimeError, match="the volume has no second derivative; take that of the potential"):
        gradient.sum().backward()


def test_a_volume_has_derivatives_by_what_it_is_multiplied_with(cube, felt):
    """They need no second derivative: those along a direction, and of a gradient by weights."""
    surface, poses = felt
    direction = torch.tensor(np.random.default_rng(4).normal(size=poses.shape))
    volume = penetration(cube, surface, poses).volume
    (gradient,) = torch.autograd.grad(volume.sum(), poses)
    expected = (gradient * direction).sum(1)
    _, along = torch.autograd.functional.jvp(lambda p: penetration(cube, surface, p).volume, poses, direction)
    assert expected.abs().max() > 0 and torch.allclose(along, expected, rtol=1e-12)
    weights = torch.ones(3, dtype=torch.float64, requires_grad=True)
    weighed = penetration(cube, surface, poses).volume @ weights
    (gradient,) = torch.autograd.grad(weighed, poses, create_graph=True)
    (by_weights,) = torch.autograd.grad((gradient * direction).sum(), weights)
    assert torch.allclose(by_weights, expected, rtol=1e-12)


def test_derivatives_by_weights_measure_no_stiffness(cube, felt, monkeypatch):
    surface, poses = felt
    weights = torch.ones(3, dtype=torch.float64, requires_grad=True)
    potential = penetration(cube, surface, poses).potential
    (gradient,) = torch.autograd.grad(potential @ weights, poses, create_graph=True)
    monkeypatch.setattr(palpate.torch, "_stiffness_of", lambda *_: pytest.fail("measured the stiffness"))
    (by_weights,) = torch.autograd.grad(gradient[:, 2].sum(), weights)
    assert torch.allclose(by_weights, gradient[:, 2], rtol=1e-12)


def test_derivatives_of_no_poses(cube, felt):
    surface, poses = felt
    none = poses[:0].detach().requires_grad_()
    for question in (lambda p: penetration(cube, surface, p).potential, lambda p: clearance(cube, surface, p)):
        (first,) = torch.autograd.grad(question(none).sum(), none, create_graph=True)
        (second,) = torch.autograd.grad(first.sum(), none)
        assert first.shape == second.shape == (0, 7)
    for question in (lambda p: penetration(cube, surface, p).volume, lambda p: wrench(cube, surface, p)):
        assert torch.autograd.grad(question(none).sum(), none)[0].shape == (0, 7)


def test_many_derivatives_at_once(cube, felt):
    """jacobian and hessian with vectorize=True, and is_grads_batched: those one by one."""
    surface, poses = felt
    given, jacobian = poses.detach(), torch.autograd.functional.jacobian
    questions = (lambda p: wrench(cube, surface, p), lambda p: clearance(cube, surface, p, limit=0.5),
                 lambda p: penetration(cube, surface, p).potential, lambda p: penetration(cube, surface, p).volume)
    for question in questions:
        expected = jacobian(question, given)
        assert expected.any() and torch.equal(jacobian(question, given, vectorize=True), expected)
    for question in questions[1:3]:
        batched = given.clone().requires_grad_()
        weights = torch.tensor(np.random.default_rng(2).normal(size=(3, *poses.shape)))
        expected, got = (
            torch.autograd.grad((jacobian(question, batched, create_graph=True, vectorize=vectorize)
                                 * weights).sum(), batched)[0] for vectorize in (False, True))
        assert expected.any() and torch.allclose(got, expected, rtol=1e-9, atol=1e-12)
        expected, got = (torch.autograd.functional.hessian(lambda p: question(p).sum(), given, vectorize=vectorize)
                         for vectorize in (False, True))
        assert expected.any() and torch.equal(got, expected)


def test_copies_for_second_derivatives_are_made_before_a_graph_captures_them(cube, felt):
    surface, poses = felt
    contact = palpate.Contact(cube)
    clearance(contact, surface, poses)
    assert poses.device in _spheres.get(contact, {})


def test_arguments_of_derivatives_belong_together():
    poses, vectors, out = np.tile(np.eye(7)[6], (2, 1)), np.zeros((2, 3)), np.zeros((2, 7))

    def pull_back(out, **more):
        _core.pull_back(poses, vectors, vectors, vectors, out, **more)

    pull_back(out)
    stiffness, p_CQ, by_scale = ({"stiffness": np.zeros((2, 6, 6))}, {"p_CQ": vectors}, {"by_scale": np.ones(2)})
    for more in (stiffness, p_CQ, by_scale, {"along": poses}, {"along": poses, **stiffness, **p_CQ}):
        with pytest.raises(ValueError, match="along: goes with one of stiffness, p_CQ and by_scale"):
            pull_back(out, **more)
    for to, more in ((out, by_scale), (None, p_CQ)):
        with pytest.raises(ValueError, match="out: give either it or by_scale"):
            pull_back(to, along=poses, **more)
    pull_back(None, along=poses, **by_scale)
    assert not by_scale["by_scale"].any()


def test_bodies_alone_are_asked_where_the_contact_is_or_the_poses(cube):
    depth, camera, _ = palpate.render_scene("wall", 0.0, width=160, height=120)
    body = palpate.Body(cube, [0.05, 0, 0.7, 0, 0, 0, 1])
    bodies, here = palpate.Scene([], [body]), torch.zeros(1, 7)
    there = SimpleNamespace(device=torch.device("cuda", 1))  # as poses on a GPU
    contact = palpate.Contact(cube)
    assert contact.place == "cpu"
    assert _place_of(cube, bodies, here) == _place_of(contact, bodies, there) == "cpu"
    assert _place_of(cube, bodies, there) == "cuda:1"
    seen = palpate.Scene([palpate.Sensor(camera).update(depth)], [body])
    assert _place_of(cube, seen, there) == _place_of(cube, [body], there) == "cpu"
