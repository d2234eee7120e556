"""palpate.torch with surfaces on a GPU, against the same in host memory, which gradcheck has checked."""

import numpy as np
import pytest
from test_gpu import Torch, on_cpu, scene  # noqa: F401

import palpate

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from palpate import _core  # noqa: E402
from palpate.torch import clearance, penetration, wrench  # noqa: E402


@pytest.fixture
def felt(cube, scene):
    torch = Torch().torch
    camera, images, poses, _ = scene
    on_gpu = palpate.Sensor(camera, place="cuda").update(images[0])
    stretched = poses.copy()
    stretched[:, 3:] *= 1.3  # quaternions of any length
    return torch, palpate.Sensor(camera).update_batch(images[:1]), on_gpu, torch.from_numpy(stretched)


def assert_close(there, here, name, tolerance=1e-4):
    assert there.device.type == "cuda"
    error = (there.cpu() - here).abs().max() / here.abs().max()
    assert error < tolerance, f"{name}: {error}"


@pytest.mark.parametrize("second", [False, True])
def test_are_those_of_the_cpu(cube, felt, second):
    torch, on_cpu, on_gpu, numbers = felt

    def derivatives(surface, poses):
        poses = poses.detach().requires_grad_()
        volume, potential = penetration(cube, surface, poses, second=second)
        (gradient,) = torch.autograd.grad(potential.sum(), poses, create_graph=True)
        direction = torch.ones_like(poses) * torch.tensor([1, 1, 1, .01, .02, .03, .04]).to(poses)
        (twice,) = torch.autograd.grad((gradient * direction).sum(), poses)
        force = wrench(cube, surface, poses)
        (by_wrench,) = torch.autograd.grad(force[:, :3].sum() + force[:, 3:].sum() * 100, poses)
        return {"volume": volume, "potential": potential, "gradient": gradient, "twice": twice, "wrench": force,
                "by wrench": by_wrench}

    here, there = derivatives(on_cpu, numbers), derivatives(on_gpu, numbers.cuda())
    for name, expected in here.items():
        assert_close(there[name].detach(), expected.detach(), name)
    assert not there["volume"].requires_grad


def test_matrices_and_bodies_alone(cube, felt):
    torch, _, on_gpu, numbers = felt
    x, y, z, w = (numbers[:, 3:] / numbers[:, 3:].norm(dim=1, keepdim=True)).unbind(1)
    X = torch.eye(4, dtype=torch.float64).repeat(len(numbers), 1, 1)
    X[:, :3, 3] = numbers[:, :3]
    X[:, 0, :3] = torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], 1)
    X[:, 1, :3] = torch.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], 1)
    X[:, 2, :3] = torch.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1)
    bodies = palpate.Scene([], [palpate.Body(cube, [0.02, 0, 0.95, 0, 0, 0, 1])])
    for scene in (on_gpu, bodies):
        by_matrix, by_numbers = (penetration(cube, scene, given.cuda()) for given in (X, numbers))
        assert_close(by_matrix.potential, by_numbers.potential.cpu(), "potential", 1e-6)
        assert_close(clearance(cube, scene, X.cuda()), clearance(cube, scene, numbers.cuda()).cpu(), "clearance")


def test_many_surfaces(cube, scene, felt):
    torch = felt[0]
    camera, images, poses, which = scene
    fields = palpate.Sensor(camera, place="cuda").update_batch(images)
    given = torch.from_numpy(poses).cuda().requires_grad_()
    potential = penetration(cube, fields, given, surface_of_pose=torch.from_numpy(which).cuda()).potential
    (gradient,) = torch.autograd.grad(potential.sum(), given)
    expected = on_cpu(cube, scene)
    assert_close(potential.detach(), torch.from_numpy(np.array(expected.potential)), "potential")
    assert_close(gradient[:, :3], torch.from_numpy(-np.array(expected.force)), "gradient")


def test_clearance_and_scenes_stay_there(cube, scene, felt):
    torch, _, on_gpu, numbers = felt
    camera, images, *_ = scene
    seen = {place: palpate.Scene([palpate.Sensor(camera, place=place).update(images[0])],
                                 [palpate.Body(cube, [0.05, 0, 0.8, 0, 0, 0, 1])]) for place in ("cpu", "cuda")}
    which = (np.arange(len(numbers)) % 2).astype(np.int32)

    def derivatives(place, poses):
        poses = poses.detach().requires_grad_()
        far = clearance(palpate.Contact([cube, cube], place=place), seen[place], poses, tool_of_pose=which)
        (by_far,) = torch.autograd.grad(far.sum(), poses)
        potential = penetration(cube, seen[place], poses, second=True).potential
        (by_potential,) = torch.autograd.grad(potential.sum(), poses, create_graph=True)
        (twice,) = torch.autograd.grad(by_potential[:, 2].sum(), poses)
        return {"clearance": far, "by clearance": by_far, "potential": potential, "gradient": by_potential, "twice": twice}

    here, there = derivatives("cpu", numbers), derivatives("cuda", numbers.cuda())
    for name, expected in here.items():
        assert_close(there[name].detach(), expected.detach(), name, 2e-3 if name == "twice" else 1e-4)


def test_captured_in_a_graph(cube, felt):
    torch, _, on_gpu, numbers = felt
    poses = numbers.cuda().requires_grad_()

    def step():
        potential = penetration(cube, on_gpu, poses, second=True).potential
        (gradient,) = torch.autograd.grad(potential.sum(), poses, create_graph=True)
        (twice,) = torch.autograd.grad(gradient.square().sum(), poses)
        (by_far,) = torch.autograd.grad(clearance(cube, on_gpu, poses).sum(), poses, create_graph=True)
        (far_twice,) = torch.autograd.grad(by_far.square().sum(), poses)
        return [each.detach() for each in (gradient, twice, by_far, far_twice)]

    side = torch.cuda.Stream()
    with torch.cuda.stream(side):
        expected = [each.clone() for each in step()]
    side.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, stream=side):
        got = step()
    with torch.no_grad():
        poses[:, 2] -= 0.3  # in front of everything
    graph.replay()
    torch.cuda.synchronize()
    for each, before in zip(got[:2], expected):
        assert each.abs().max() < before.abs().max() / 100
    with torch.no_grad():
        poses.copy_(numbers)
    graph.replay()
    torch.cuda.synchronize()
    for each, before in zip(got, expected):
        assert torch.equal(each, before)


def test_single_precision(cube, felt):
    torch, _, on_gpu, numbers = felt

    def derivatives(poses):
        poses = poses.cuda().requires_grad_()
        (first,) = torch.autograd.grad(penetration(cube, on_gpu, poses).potential.sum(), poses, create_graph=True)
        return first, torch.autograd.grad(first[:, 2].sum(), poses)[0]

    for one, other in zip(derivatives(numbers.float()), derivatives(numbers)):
        assert one.dtype == torch.float32
        assert_close(one.detach().double(), other.detach().cpu(), "single precision", 1e-2)


def test_poses_that_are_none_give_zero(cube, felt):
    torch, _, on_gpu, numbers = felt
    poses = numbers[:4].cuda()
    poses[1, 3], poses[2, 3:] = float("nan"), 0
    poses.requires_grad_()
    potential = penetration(cube, on_gpu, poses).potential
    (gradient,) = torch.autograd.grad(potential.sum(), poses, create_graph=True)
    (twice,) = torch.autograd.grad(gradient.sum(), poses)
    for each in (potential, gradient, twice):
        assert each.isfinite().all() and not each[1:3].any()


@pytest.mark.skipif(torch.cuda.device_count() < 2, reason="needs two GPUs")
def test_the_current_device_stays():
    poses = torch.zeros(2, 7, dtype=torch.float64, device="cuda:1")
    with torch.cuda.device(0):
        _core.plain_poses(poses, torch.empty_like(poses))
        assert torch.cuda.current_device() == 0
