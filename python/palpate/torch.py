"""Differentiable contact for PyTorch: palpate.torch.penetration, wrench and clearance.

With one surface in host memory, volume, potential and wrench are computed in double, element by element: the
exact derivatives of the field measure. With surfaces or scenes on a GPU they are those of Contact.measure_batch,
in PyTorch's current stream: nothing leaves the GPU, and a CUDA graph can capture all of it after one call with
the same tool and scene, and its gradient, outside of the capture. It is valid until the tool is asked about another scene: contacts
of one tool and place are shared, so give a palpate.Contact of its own for each graph.

With poses in float64 the gradient of a potential is one launch, and so is a product of its second derivatives with
second=True. Many first derivatives at once (functional.jacobian with vectorize=True) are computed one by one.
torch.func, forward mode and third derivatives are not supported.
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
from palpate._torch_derivatives import Slope, Value, pulled_back, stream_of

__all__ = ["Penetration", "clearance", "penetration", "wrench"]

#: A tool, or a contact with one.
ToolOrContact = Union[_core.Tool, _core.Contact]

_contacts: "weakref.WeakKeyDictionary[_core.Tool, Dict[str, _core.Contact]]" = weakref.WeakKeyDictionary()
_differentiated: "weakref.WeakKeyDictionary[ToolOrContact, _core.Differentiated]" = weakref.WeakKeyDictionary()
_centers: "weakref.WeakKeyDictionary[ToolOrContact, Dict[torch.device, torch.Tensor]]" = weakref.WeakKeyDictionary()
_spheres: "weakref.WeakKeyDictionary[_core.Contact, Dict[torch.device, torch.Tensor]]" = weakref.WeakKeyDictionary()


class Penetration(NamedTuple):
    """Result of `penetration`: (P,) each."""

    #: Volume of the tool inside the scene, m3.
    volume: torch.Tensor
    #: Potential, m4; its negative gradient by the pose is the wrench.
    potential: torch.Tensor


class _Question(NamedTuple):
    """One tool or contact, what it is measured against and where, and the surface of each pose."""

    tool: ToolOrContact
    scene: Any
    device: torch.device
    surface_of_pose: Optional[torch.Tensor] = None


class _Found(NamedTuple):
    """Results in double where they were measured, (P,) (P,) (P, 6) (P, 3) (P, 3) (P, 6, 6)."""

    volume: torch.Tensor
    potential: torch.Tensor
    volume_gradient: Optional[torch.Tensor]
    force_W: torch.Tensor
    torque_W: torch.Tensor
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
    contact_scene = asked.scene
    if isinstance(contact_scene, _core.Scene) and contact_scene.unseen == "solid":
        if not contact_scene.bodies and len(contact_scene.cameras) == 1:
            contact_scene = contact_scene.cameras[0]
    if asked.device.type != "cpu":
        return _measure_on_gpu(asked, contact_scene, poses, with_stiffness)
    numbers = np.ascontiguousarray(poses.detach().to(torch.float64).numpy())
    if not isinstance(contact_scene, _core.Surface):
        which = None if asked.surface_of_pose is None else asked.surface_of_pose.cpu().numpy()
        batch = _contact_of(asked.tool, "cpu").measure_batch(
            contact_scene, numbers, surface_of_pose=which, stiffness=True
        )
        volume, potential, force, torque, stiffness = (
            torch.from_numpy(np.array(each))
            for each in (batch.volume, batch.potential, batch.force, batch.torque, batch.stiffness)
        )
        return _Found(volume, potential, None, force, torque, stiffness)
    by_definition = _differentiated.get(asked.tool)
    if by_definition is None:
        by_definition = _differentiated[asked.tool] = _core.Differentiated(_only_tool(asked.tool))
    found = by_definition(contact_scene, numbers)
    volume, potential, by_motion, both, stiffness = (torch.from_numpy(array) for array in found)
    return _Found(volume, potential, by_motion, both[:, :3], both[:, 3:], stiffness)


def _measure_on_gpu(asked: _Question, scene: Any, poses: torch.Tensor, with_stiffness: bool) -> _Found:
    there, which = _plain(poses), asked.surface_of_pose
    found = {name: there.new_empty(len(there)) for name in ("volume", "potential")}
    found.update({name: there.new_empty(len(there), 3) for name in ("force", "torque")})
    if with_stiffness:
        found["stiffness"] = there.new_empty(len(there), 6, 6)
    _contact_of(asked.tool, str(asked.device)).measure_batch(
        scene,
        there,
        surface_of_pose=None if which is None else which.to(asked.device, torch.int32),
        stiffness=with_stiffness,
        out=_core.Batch(**found),
        stream=stream_of(asked.device),
    )
    return _Found(
        found["volume"], found["potential"], None, found["force"], found["torque"], found.get("stiffness")
    )


def _plain(poses: torch.Tensor) -> torch.Tensor:
    """The poses as Contact.measure_batch takes them on their GPU, (P, 7) in double; not finite where there is none."""
    there = poses.new_empty(len(poses), 7, dtype=torch.float64)
    _core.plain_poses(poses.detach().contiguous(), there, stream=stream_of(poses.device))
    return there


def _center_of(tool: ToolOrContact, poses: torch.Tensor) -> torch.Tensor:
    """The center of mass (P, 3) of the only tool, a row for all."""
    by_device = _centers.setdefault(tool, {})
    if poses.device not in by_device:
        center = np.array(_only_tool(tool).center_of_mass, np.float64)
        by_device[poses.device] = torch.from_numpy(center).to(poses.device)
    return by_device[poses.device].expand(len(poses), 3)


class _Wrench(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, asked: _Question, found: _Found) -> torch.Tensor:
        ctx.asked, ctx.found = asked, found
        ctx.save_for_backward(poses)
        return torch.cat([found.force_W, found.torque_W], 1).to(poses.dtype)

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, by_wrench: torch.Tensor) -> Tuple[Any, ...]:
        (poses,) = ctx.saved_tensors
        stiffness = _stiffness_of(ctx.asked, ctx.found, poses)
        by_motion = (by_wrench.to(stiffness.dtype)[:, :, None] * stiffness).sum(1)
        slope = Slope(-1, by_motion[:, :3], by_motion[:, 3:], _center_of(ctx.asked.tool, poses))
        return pulled_back(slope, poses), None, None


def _stiffness_of(asked: _Question, found: _Found, poses: torch.Tensor) -> torch.Tensor:
    """The stiffness that was found, or else is measured now."""
    stiffness = found.stiffness if found.stiffness is not None else _measure(asked, poses, True).stiffness
    assert stiffness is not None
    return stiffness


def _checked(poses: torch.Tensor) -> torch.Tensor:
    if poses.dtype not in (torch.float64, torch.float32):
        raise ValueError(f"poses: numbers of type {poses.dtype} are not taken; give float64, or float32")
    shape = tuple(poses.shape)
    if len(shape) not in (2, 3) or shape[1:] not in ((7,), (4, 4)):
        raise ValueError(f"poses: shape {shape} is not (P, 4, 4) or (P, 7)")
    return poses


def _asked(
    tool: ToolOrContact, scene: Any, poses: torch.Tensor, surface_of_pose: Optional[torch.Tensor]
) -> _Question:
    _checked(poses)
    if isinstance(tool, _core.Contact) and len(tool.tools) > 1:
        raise ValueError("tool: penetration takes one tool at a time, not a contact with several")
    if surface_of_pose is not None and isinstance(scene, (_core.Surface, _core.Scene, _core.Body)):
        raise ValueError("surface_of_pose: there is one scene; give palpate.Surfaces or a list for several")
    return _Question(tool, scene, torch.device(_place_of(tool, scene, poses)), surface_of_pose)


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
    poses: (P, 7) tx ty tz qx qy qz qw, with quaternions of any length, or (P, 4, 4), float64 or float32;
    results are on their device. The gradient of the potential is exactly minus the wrench, and its second
    derivative the stiffness. With one camera in host memory, the gradient of the volume is exact, too, but
    has no second derivative; on a GPU, with several cameras or bodies the volume has no gradient. For
    (P, 4, 4) it is the gradient along rotations.

    Surfaces and scenes on a GPU: one launch in PyTorch's current stream, after one for the poses. A scene
    of bodies alone is asked where a contact is that is given as the tool, else where the poses are. second:
    measure the stiffness in the same launch; without it a second derivative measures once more. Poses that are
    not finite, or have a quaternion of zeros, give zero.
    """
    asked = _asked(tool, scene, poses, surface_of_pose)
    there = poses.to(asked.device)
    found = _measure(asked, there, second)
    p_TC = _center_of(tool, there)
    slope = Slope(
        -1, found.force_W, found.torque_W, p_TC, lambda at: {"stiffness": _stiffness_of(asked, found, at)}
    )
    potential = Value.apply(there, found.potential, slope)  # type: ignore[no-untyped-call]
    volume, by_motion = found.volume.to(poses.dtype), found.volume_gradient
    if by_motion is not None:
        slope = Slope(1, by_motion[:, :3], by_motion[:, 3:], p_TC)
        volume = Value.apply(there, volume, slope)  # type: ignore[no-untyped-call]
    return Penetration(volume.to(poses.device), potential.to(poses.device))


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
    as in `penetration`; for (P, 4, 4), too, gradients are those along rotations. The gradient is exact for the nearest sphere and what it is near to; where
    that changes the clearance has a kink. Second derivatives are those of a sphere before a plane. On a GPU
    nothing leaves it; tool_of_pose is in host memory.
    Beyond `limit` (m) the clearance is constant.
    """
    place = _place_of(tool, scene, _checked(poses))
    contact, there = _contact_of(tool, place), poses.to(torch.device(place))
    numbers = _plain(there) if place != "cpu" else there.detach().to(torch.float64).contiguous()
    value, gradient = (numbers.new_empty(len(there), *shape) for shape in ((), (6,)))
    nearest = torch.empty(len(there), dtype=torch.int32, device=there.device)
    contact.measure_batch(
        scene,
        numbers,
        clearance=True,
        limit=limit,
        tool_of_pose=tool_of_pose,
        out=_core.Batch(clearance=value, clearance_gradient=gradient, nearest=nearest),
        stream=stream_of(there.device),
    )
    if tool_of_pose is None:
        p_TC = _center_of(contact, there)
    else:
        centers = np.array([each.center_of_mass for each in contact.tools], np.float64)
        p_TC = torch.from_numpy(centers[np.asarray(tool_of_pose)]).to(there.device)

    centers_of_spheres = _centers_of_spheres(contact, there.device)  # here: no graph captures this copy

    def sphere_before_a_plane(_: torch.Tensor) -> Dict[str, torch.Tensor]:
        number = nearest.clamp(min=0).long()
        if tool_of_pose is not None:
            first = np.cumsum([0] + [len(each.spheres) for each in contact.tools])
            number = number + torch.from_numpy(first[np.asarray(tool_of_pose)]).to(there.device)
        return {"p_CQ": centers_of_spheres[number] - p_TC}

    slope = Slope(1, gradient[:, :3], gradient[:, 3:], p_TC, sphere_before_a_plane)
    return Value.apply(there, value, slope).to(poses.device)  # type: ignore[no-untyped-call,no-any-return]


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
    asked = _asked(tool, scene, poses, surface_of_pose)
    there = poses.to(asked.device)
    found = _measure(asked, there, poses.requires_grad)
    return _Wrench.apply(there, asked, found).to(poses.device)  # type: ignore[no-untyped-call,no-any-return]
