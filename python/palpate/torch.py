"""Differentiable contact for PyTorch: palpate.torch.penetration, wrench and clearance.

With one surface in host memory, volume, potential and wrench are computed in double, element by element: the
exact derivatives of the field measure. With surfaces or scenes on a GPU they are those of Contact.measure_batch,
in PyTorch's current stream: nothing leaves the GPU, and a CUDA graph can capture all of it after one call with
the same tool and scene, and its gradient, outside of the capture. It is valid until the tool is asked about another scene: contacts
of one tool and place are shared, so give a palpate.Contact of its own for each graph.
"""

from __future__ import annotations

import weakref
from typing import Any, Dict, NamedTuple, Optional, Tuple, Union

import numpy as np

try:
    import torch
except ImportError as error:
    raise ImportError("palpate.torch needs PyTorch: pip install torch") from error

from palpate import _core

__all__ = ["Penetration", "clearance", "penetration", "wrench"]

#: A tool, or a contact with one.
ToolOrContact = Union[_core.Tool, _core.Contact]

_contacts: "weakref.WeakKeyDictionary[_core.Tool, Dict[str, _core.Contact]]" = weakref.WeakKeyDictionary()
_differentiated: "weakref.WeakKeyDictionary[ToolOrContact, _core.Differentiated]" = weakref.WeakKeyDictionary()
_centers: "weakref.WeakKeyDictionary[ToolOrContact, Dict[torch.device, torch.Tensor]]" = weakref.WeakKeyDictionary()
_spheres: "weakref.WeakKeyDictionary[_core.Contact, Dict[torch.device, torch.Tensor]]" = weakref.WeakKeyDictionary()
_identities: Dict[torch.device, torch.Tensor] = {}


class Penetration(NamedTuple):
    """Result of `penetration`: (P,) each."""

    #: Volume of the tool inside the scene, m3.
    volume: torch.Tensor
    #: Potential, m4; its negative gradient by the pose is the wrench.
    potential: torch.Tensor


class _Question(NamedTuple):
    """One tool or contact, what it is measured against, and the surface of each pose."""

    tool: ToolOrContact
    scene: Any
    surface_of_pose: Optional[torch.Tensor] = None


class _Found(NamedTuple):
    """Results in double where they were measured, (P,) (P,) (P, 6) (P, 6) (P, 6, 6)."""

    volume: torch.Tensor
    potential: torch.Tensor
    volume_gradient: Optional[torch.Tensor]
    wrench_W: torch.Tensor
    stiffness: Optional[torch.Tensor]


def _only_tool(tool: ToolOrContact) -> _core.Tool:
    return tool if isinstance(tool, _core.Tool) else tool.tool


def _place_of(tool: ToolOrContact, scene: Any, poses: torch.Tensor) -> str:
    """Returns the place of the surfaces; of bodies alone that of the contact, if it is given, or of the poses."""
    if isinstance(scene, _core.Scene):
        if not scene.cameras:
            if isinstance(tool, _core.Contact):
                return tool.place
            return str(poses.device) if poses.device.type == "cuda" else "cpu"
        scene = scene.cameras[0]
    return scene.place if isinstance(scene, (_core.Surface, _core.Surfaces)) else "cpu"


def _contact_of(tool: ToolOrContact, place: str) -> _core.Contact:
    if isinstance(tool, _core.Contact):
        return tool
    by_place = _contacts.setdefault(tool, {})
    if place not in by_place:
        by_place[place] = _core.Contact(tool, place=place)
    return by_place[place]


def _measure(asked: _Question, poses: torch.Tensor, with_stiffness: bool) -> _Found:
    tool, scene, surface_of_pose = asked
    if isinstance(scene, _core.Scene) and scene.unseen == "solid" and not scene.bodies and len(scene.cameras) == 1:
        scene = scene.cameras[0]
    place = _place_of(tool, scene, poses)
    if place != "cpu":
        return _measure_on_gpu(place, _Question(tool, scene, surface_of_pose), poses, with_stiffness)
    numbers = np.ascontiguousarray(poses.detach().to("cpu", torch.float64).numpy())
    if not isinstance(scene, _core.Surface):
        which = None if surface_of_pose is None else surface_of_pose.cpu().numpy()
        batch = _contact_of(tool, place).measure_batch(scene, numbers, surface_of_pose=which, stiffness=True)
        both = np.concatenate([batch.force, batch.torque], 1)
        volume, potential, wrench_W, stiffness = (
            torch.from_numpy(np.array(each)) for each in (batch.volume, batch.potential, both, batch.stiffness)
        )
        return _Found(volume, potential, None, wrench_W, stiffness)
    by_definition = _differentiated.get(tool)
    if by_definition is None:
        by_definition = _differentiated[tool] = _core.Differentiated(_only_tool(tool))
    return _Found(*(torch.from_numpy(array) for array in by_definition(scene, numbers)))


def _measure_on_gpu(place: str, asked: _Question, poses: torch.Tensor, with_stiffness: bool) -> _Found:
    device = torch.device(place)
    there = _numbers(poses, device)
    there = torch.cat([there[:, :3], there[:, 3:] / there[:, 3:].norm(dim=1, keepdim=True)], 1)

    def empty(*shape: int) -> torch.Tensor:
        return torch.empty(len(there), *shape, dtype=torch.float64, device=device)

    found = {"volume": empty(), "potential": empty(), "force": empty(3), "torque": empty(3)}
    if with_stiffness:
        found["stiffness"] = empty(6, 6)
    which = asked.surface_of_pose
    _contact_of(asked.tool, place).measure_batch(
        asked.scene,
        there,
        surface_of_pose=None if which is None else which.to(device, torch.int32),
        stiffness=with_stiffness,
        out=_core.Batch(**found),
        stream=torch.cuda.current_stream(device),
    )
    wrench_W = torch.cat([found["force"], found["torque"]], 1)
    return _Found(found["volume"], found["potential"], None, wrench_W, found.get("stiffness"))


def _numbers(poses: torch.Tensor, device: torch.device) -> torch.Tensor:
    """The poses as Contact.measure_batch takes them on a device."""
    there = poses.detach().to(device, torch.float64)
    return (there if there.ndim == 2 or device.type == "cpu" else _sevens(there)).contiguous()


def _sevens(X: torch.Tensor) -> torch.Tensor:
    """Matrices (P, 4, 4) as (P, 7) tx ty tz qx qy qz qw, with quaternions of any length."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(1) for row in X[:, :3, :3].unbind(1))
    # 4 q q^T for a unit quaternion q: each of its rows is a multiple of q, the longest one the best
    rows = [
        [1 + xx - yy - zz, yx + xy, xz + zx, zy - yz],
        [yx + xy, 1 - xx + yy - zz, zy + yz, xz - zx],
        [xz + zx, zy + yz, 1 - xx - yy + zz, yx - xy],
        [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
    ]
    products = torch.stack([torch.stack(row, 1) for row in rows], 1)
    # The products have trace 4, and a square 4 times themselves, where the matrix is a rotation; else there is no pose.
    is_rotation = ((products @ products - 4 * products).abs().amax((1, 2)) < 1e-5) & (
        (products.diagonal(dim1=1, dim2=2).sum(1) - 4).abs() < 1e-5)
    products = torch.where(is_rotation[:, None, None], products, torch.nan)
    longest = products.diagonal(dim1=1, dim2=2).argmax(1)[:, None, None].expand(-1, 1, 4)
    return torch.cat([X[:, :3, 3], products.gather(1, longest)[:, 0]], 1)


def _center_of(tool: ToolOrContact, device: torch.device) -> torch.Tensor:
    by_device = _centers.setdefault(tool, {})
    if device not in by_device:
        center = np.array(_only_tool(tool).center_of_mass, np.float64)
        by_device[device] = torch.from_numpy(center).to(device)
    return by_device[device]


def _by_pose(by_motion: torch.Tensor, asked: _Question, poses: torch.Tensor) -> torch.Tensor:
    """Gradient by the numbers of the poses, in their shape and type.

    by_motion: (P, 6) by the shift of the tool's center of mass and by the rotation about it, both in W.
    """
    inside = poses.to(by_motion)
    p_TC = _center_of(asked.tool, by_motion.device)
    by_shift, by_turn = torch.split(by_motion, 3, 1)  # in derivatives one launch, unlike slices
    if poses.ndim == 2:
        # Every operation is a launch on a GPU, and more in derivatives. Poses that are no poses have no force;
        # there the identity stands for them.
        _, q = torch.split(inside, [3, 4], 1)
        length2 = q.detach().square().sum(1, keepdim=True)
        q = torch.where((length2 > 0) & (length2 < torch.inf), q, _identity(q.device))
        # turn = 2 vec(dq q*) / |q|^2, for any length of q
        per_length = 2 / q.square().sum(1, keepdim=True)
        axis, w = torch.split(q, [3, 1], 1)
        by_turn = (by_turn + torch.linalg.cross(_rotated(axis, w, p_TC, per_length), by_shift)) * per_length
        by_axis = torch.addcmul(torch.linalg.cross(by_turn, axis), w, by_turn)
        return torch.cat([by_shift, by_axis, -(by_turn * axis).sum(1, keepdim=True)], 1).to(poses)
    R = inside[:, :3, :3]
    by_turn = by_turn + torch.linalg.cross(R @ p_TC, by_shift)
    # turn = vec of the antisymmetric part of dR R^T, for changes that leave R a rotation
    by_R = torch.linalg.cross(by_turn[:, :, None].expand_as(R), R, dim=1) / 2
    top = torch.cat([by_R, by_shift[:, :, None]], 2)
    return torch.nn.functional.pad(top, (0, 0, 0, 1)).to(poses)


def _identity(device: torch.device) -> torch.Tensor:
    if device not in _identities:
        _identities[device] = torch.tensor([0, 0, 0, 1], dtype=torch.float64, device=device)
    return _identities[device]


def _rotated(axis: torch.Tensor, w: torch.Tensor, v: torch.Tensor, per_length: torch.Tensor) -> torch.Tensor:
    """v (P, 3) or (3,), rotated by quaternions q = (axis, w) of any length; per_length: 2 / |q|^2."""
    fixed = v.expand(len(axis), 3)
    once = torch.linalg.cross(axis, fixed)
    return torch.addcmul(fixed, per_length, torch.addcmul(torch.linalg.cross(axis, once), w, once))


class _Wrench(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, asked: _Question, found: _Found) -> torch.Tensor:
        ctx.asked, ctx.stiffness = asked, found.stiffness
        ctx.save_for_backward(poses)
        return found.wrench_W.detach()  # another tensor over the same numbers

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, by_wrench: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        stiffness = ctx.stiffness
        if stiffness is None:
            stiffness = _measure(ctx.asked, poses, True).stiffness
        by_motion = -(by_wrench[:, :, None] * stiffness).sum(1)
        return _by_pose(by_motion, ctx.asked, poses), None, None


class _Penetration(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, poses: torch.Tensor, asked: _Question, second: bool
    ) -> Tuple[torch.Tensor, torch.Tensor]:
        found = _measure(asked, poses, second)
        ctx.asked, ctx.found = asked, found
        ctx.save_for_backward(poses)
        volume = found.volume.to(poses)
        if found.volume_gradient is None:
            ctx.mark_non_differentiable(volume)
        return volume, found.potential.to(poses)

    @staticmethod
    def backward(ctx: Any, by_volume: torch.Tensor, by_potential: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        # The wrench is differentiable, and so is this gradient.
        wrench_W = _Wrench.apply(poses, ctx.asked, ctx.found)  # type: ignore[no-untyped-call]
        by_motion = -by_potential.to(wrench_W)[:, None] * wrench_W
        if ctx.found.volume_gradient is not None:
            by_motion = by_motion + by_volume.to(wrench_W)[:, None] * ctx.found.volume_gradient
        return _by_pose(by_motion, ctx.asked, poses), None, None


def _checked(poses: torch.Tensor) -> torch.Tensor:
    if not poses.is_floating_point():
        raise ValueError(f"poses: numbers of type {poses.dtype} have no gradient; give float64")
    shape = tuple(poses.shape)
    if len(shape) not in (2, 3) or shape[1:] not in ((7,), (4, 4)):
        raise ValueError(f"poses: shape {shape} is not (P, 4, 4) or (P, 7)")
    return poses


def _asked(tool: ToolOrContact, scene: Any, surface_of_pose: Optional[torch.Tensor]) -> _Question:
    if isinstance(tool, _core.Contact) and len(tool.tools) > 1:
        raise ValueError("tool: penetration takes one tool at a time, not a contact with several")
    if surface_of_pose is not None and isinstance(scene, (_core.Surface, _core.Scene, _core.Body)):
        raise ValueError("surface_of_pose: there is one scene; give palpate.Surfaces or a list for several")
    return _Question(tool, scene, surface_of_pose)


def penetration(
    tool: ToolOrContact,
    scene: Any,
    poses: torch.Tensor,
    *,
    surface_of_pose: Optional[torch.Tensor] = None,
    second: bool = False,
) -> Penetration:
    """Volume (P,) m3 and potential (P,) m4 of the tool at poses X_WT, differentiable by the poses.

    scene: a Surface, Body or Scene, or Surfaces, of which surface_of_pose (P,) int32 are the indices.
    poses: (P, 7) tx ty tz qx qy qz qw, with quaternions of any length, or (P, 4, 4); results are on their
    device. The gradient of the potential is exactly minus the wrench, and its second derivative the
    stiffness. With one camera in host memory, the gradient of the volume is exact, too, but has no second
    derivative; on a GPU, with several cameras or bodies the volume has no gradient. For (P, 4, 4) it is the
    gradient along rotations.

    Surfaces and scenes on a GPU: one launch in PyTorch's current stream. A scene of bodies alone is asked where
    a contact is that is given as the tool, else where the poses are. second: measure the stiffness in the same
    launch; without it a second derivative is a launch more. Poses that are not finite, or have a quaternion of
    zeros, give zero.
    """
    volume, potential = _Penetration.apply(_checked(poses), _asked(tool, scene, surface_of_pose), second)  # type: ignore[no-untyped-call]
    return Penetration(volume, potential)


def clearance(
    tool: ToolOrContact,
    scene: Any,
    poses: torch.Tensor,
    *,
    limit: float = 0.1,
    tool_of_pose: Optional[np.ndarray] = None,
) -> torch.Tensor:
    """Least distance (P,) m of the tool to the scene, see Batch.clearance, differentiable by the poses.

    tool: a tool, or a contact with one or several, of which tool_of_pose (P,) are the indices. poses:
    as in `penetration`. The gradient is exact for the nearest sphere and what it is near to; where
    that changes the clearance has a kink. Second derivatives are those of a sphere before a plane. On a GPU
    nothing leaves it; tool_of_pose is in host memory.
    Beyond `limit` (m) the clearance is constant.
    """
    place = _place_of(tool, scene, poses)
    contact, device = _contact_of(tool, place), torch.device(place)
    there = _numbers(_checked(poses), device)
    value, gradient = (there.new_empty(len(there), *shape) for shape in ((), (6,)))
    nearest = torch.empty(len(there), dtype=torch.int32, device=device)
    contact.measure_batch(
        scene,
        there,
        clearance=True,
        limit=limit,
        tool_of_pose=tool_of_pose,
        out=_core.Batch(clearance=value, clearance_gradient=gradient, nearest=nearest),
        stream=None if place == "cpu" else torch.cuda.current_stream(device),
    )
    number = nearest.clamp(min=0).long()
    if tool_of_pose is not None:
        first = np.cumsum([0] + [len(each.spheres) for each in contact.tools])
        number = number + torch.from_numpy(first[np.asarray(tool_of_pose)]).to(device)
    c_T = _centers_of_spheres(contact, device)[number].to(poses)
    normal = gradient[:, :3].to(poses)
    if poses.ndim == 2:
        q = poses[:, 3:]
        c_W = poses[:, :3] + _rotated(q[:, :3], q[:, 3:], c_T, 2 / q.square().sum(1, keepdim=True))
    else:
        c_W = poses[:, :3, 3] + (poses[:, :3, :3] @ c_T[:, :, None])[:, :, 0]
    return value.to(poses) + (normal * (c_W - c_W.detach())).sum(1)


def _centers_of_spheres(contact: _core.Contact, device: torch.device) -> torch.Tensor:
    """Those of all tools, one tool after the other."""
    by_device = _spheres.setdefault(contact, {})
    if device not in by_device:
        centers = np.concatenate([tool.spheres[:, :3] for tool in contact.tools]).astype(np.float64)
        by_device[device] = torch.from_numpy(centers).to(device)
    return by_device[device]


def wrench(
    tool: ToolOrContact, scene: Any, poses: torch.Tensor, *, surface_of_pose: Optional[torch.Tensor] = None
) -> torch.Tensor:
    """Force and torque (P, 6), m3 and m4, in W about the tool's center of mass; see `penetration`.

    Its backward is the stiffness in closed form. With surfaces in host memory, gradients of the field longer
    than 1.05 are not shortened, unlike in Contact.measure: there the wrench is the derivative of the
    potential everywhere.
    """
    asked = _asked(tool, scene, surface_of_pose)
    found = _measure(asked, _checked(poses), poses.requires_grad)
    return _Wrench.apply(poses, asked, found).to(poses)  # type: ignore[no-untyped-call,no-any-return]
