"""Arrays of PyTorch and CuPy on a GPU: in and out without a copy, in the caller's stream, captured in a graph."""

import threading

import numpy as np
import pytest

import palpate

NUM_IMAGES, NUM = 4, 500


@pytest.fixture(scope="module")
def scene():
    """Images, poses in front of and inside their surfaces, and the results of the CPU."""
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    try:
        palpate.Sensor(camera, place="cuda")
    except palpate.Error as error:
        pytest.skip(f"no GPU: {error}")
    images = np.stack([depth + np.float32(0.01 * k) for k in range(NUM_IMAGES)])
    random = np.random.default_rng(7)
    at = palpate.Sensor(camera).update(depth).points[30:90, 40:120].reshape(-1, 3)
    q = random.normal(size=(NUM, 4))
    poses = np.concatenate([at[random.choice(len(at), NUM)], q / np.linalg.norm(q, axis=1)[:, None]], axis=1)
    poses[:, 2] += random.uniform(-0.02, 0.02, NUM)
    return camera, images, poses, (np.arange(NUM) % NUM_IMAGES).astype(np.int32)


class Torch:
    """Operations of an array library that the tests need."""

    def __init__(self):
        self.torch = pytest.importorskip("torch", reason="PyTorch is not installed")
        if not self.torch.cuda.is_available():
            pytest.skip("PyTorch sees no GPU")

    def on_gpu(self, array):
        return self.torch.from_numpy(np.ascontiguousarray(array)).cuda()

    def host(self, array):
        return array.cpu().numpy()

    def taken(self, array):
        return self.torch.from_dlpack(array).cpu().numpy()

    def address(self, array):
        return array.data_ptr()

    def stream(self):
        return self.torch.cuda.Stream()

    def within(self, stream):
        return self.torch.cuda.stream(stream)

    def wait(self):
        self.torch.cuda.synchronize()

    def keep_busy(self):
        self.torch.cuda._sleep(200_000_000)  # cycles: about 0.1 s

    def write(self, to, numbers):
        to.copy_(numbers)

    def captured(self, work):
        graph = self.torch.cuda.CUDAGraph()
        with self.torch.cuda.graph(graph):
            work(self.torch.cuda.current_stream())
        return graph.replay


class CuPy:
    def __init__(self):
        self.cupy = pytest.importorskip("cupy", reason="CuPy is not installed")

    def on_gpu(self, array):
        return self.cupy.asarray(array)

    def host(self, array):
        return array.get()

    def taken(self, array):
        return self.cupy.from_dlpack(array).get()

    def address(self, array):
        return array.data.ptr

    def stream(self):
        return self.cupy.cuda.Stream(non_blocking=True)

    def within(self, stream):
        return stream

    def wait(self):
        self.cupy.cuda.Device().synchronize()

    def keep_busy(self):
        large = self.cupy.ones((2048, 2048))
        for _ in range(40):
            large = large @ large * 1e-6

    def write(self, to, numbers):
        to[...] = numbers

    def captured(self, work):
        stream = self.stream()
        with stream:
            stream.begin_capture()
            work(stream)
            graph = stream.end_capture()
        return lambda: graph.launch(stream)


@pytest.fixture(scope="module", params=[Torch, CuPy])
def library(request, scene):
    return request.param()


def answers(library, num=NUM):
    """A Batch over arrays of the library, and these arrays."""
    arrays = {"volume": np.full(num, np.nan), "potential": np.full(num, np.nan), "force": np.full((num, 3), np.nan),
              "torque": np.full((num, 3), np.nan), "status": np.full(num, 77, np.int32).view(np.uint32)}
    there = {name: library.on_gpu(array) for name, array in arrays.items()}
    return palpate.Batch(**there), there


def on_cpu(cube, scene, shift=0.0):
    camera, images, poses, which = scene
    fields = palpate.Sensor(camera).update_batch(images + np.float32(shift))
    return palpate.Contact(cube).measure_batch(fields, poses, surface_of_pose=which)


def assert_same(there, expected, library):
    for name in ("volume", "potential", "force", "torque"):
        numbers = getattr(expected, name)
        assert np.abs(library.host(there[name]) - numbers).max() < 1e-5 * np.abs(numbers).max(), name
    assert (library.host(there["status"]) == expected.status).all()
    assert (expected.volume > 0).sum() > NUM / 4


def test_in_and_out_without_a_copy(cube, scene, library):
    camera, images, poses, which = scene
    sensor, contact = palpate.Sensor(camera, place="cuda"), palpate.Contact(cube, place="cuda")
    fields = sensor.update_batch(library.on_gpu(images))
    out, there = answers(library)
    before = {name: library.address(array) for name, array in there.items()}
    contact.measure_batch(fields, library.on_gpu(poses), surface_of_pose=library.on_gpu(which), out=out)
    library.wait()
    assert_same(there, on_cpu(cube, scene), library)
    assert {name: library.address(array) for name, array in there.items()} == before
    own = contact.measure_batch(fields, library.on_gpu(poses), surface_of_pose=library.on_gpu(which))
    library.wait()
    assert np.array_equal(library.taken(own.volume), library.host(there["volume"]))
    # The same bits from host memory.
    assert np.array_equal(library.taken(contact.measure_batch(fields, poses, surface_of_pose=which).volume),
                          library.host(there["volume"]))


def test_one_image(cube, scene, library):
    camera, images, poses, _ = scene
    surface = palpate.Sensor(camera, place="cuda").update(library.on_gpu(images[0]))
    points = library.taken(surface.points_C)
    expected = palpate.Sensor(camera).update(images[0]).points
    assert np.array_equal(np.isfinite(points), np.isfinite(expected))
    assert np.nanmax(np.abs(points - expected)) < 1e-5
    assert palpate.Contact(cube, place="cuda").measure(surface, poses[0]).volume == pytest.approx(
        palpate.Contact(cube).measure(palpate.Sensor(camera).update(images[0]), poses[0]).volume, rel=1e-4, abs=1e-12)


ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.08 0.3"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0 0 0.1"/><geometry><box size="0.05 0.05 0.2"/></geometry></collision></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="1 0 0"/></joint>
<joint name="elbow" type="revolute"><origin xyz="0 0 0.3"/><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2"/></joint>
</robot>"""


def test_configurations_of_a_robot(scene, library, tmp_path):
    camera, images, *_ = scene
    (tmp_path / "arm.urdf").write_text(ARM)
    base = [0, -0.3, 0.75, -0.707, 0, 0, 0.707]
    cpu, gpu = (palpate.Robot(tmp_path / "arm.urdf", base=base, place=place) for place in ("cpu", "cuda"))
    seen, there = (palpate.Scene([palpate.Sensor(camera, place=place).update(images[0])]) for place in ("cpu", "cuda"))
    joints = np.random.default_rng(3).uniform(-1.5, 2.5, (NUM, 2))
    want = cpu.measure(seen, joints, contact=False)
    for given, host in ((library.on_gpu(joints), library.taken), (joints, np.asarray)):
        got = gpu.measure(there, given, contact=False)
        assert np.abs(host(got.clearance) - want.clearance).max() < 1e-5
        assert (host(got.held) == want.held).all() and want.held.any()
        same = (host(got.link) == want.link) | (want.clearance <= -0.1)  # of deep links either may be named
        assert same.mean() > 0.99 and (want.link >= 0).any()
        assert np.abs(host(got.clearance_by_joint) - want.clearance_by_joint)[same].max() < 1e-2
        blocked = host(gpu.any(there, given, 0.02))
        assert blocked.dtype == bool
        assert (blocked == cpu.any(seen, joints, 0.02)).mean() > 0.99
    with pytest.raises(palpate.Error, match="host memory"):
        gpu.measure(there, library.on_gpu(joints))
    with pytest.raises(palpate.Error, match="'elbow' of configuration .* beyond its limits"):
        gpu.any(there, library.on_gpu(joints), limits="refuse")


def test_a_robot_is_measured_with_all_defaults(scene, tmp_path):
    camera, images, *_ = scene
    (tmp_path / "arm.urdf").write_text(ARM)
    base = [0, -0.3, 0.75, -0.707, 0, 0, 0.707]
    joints = np.random.default_rng(4).uniform(-1.5, 2, (50, 2))
    got, want = (
        palpate.Robot(tmp_path / "arm.urdf", base=base, place=place).measure(
            palpate.Scene([palpate.Sensor(camera, place=place).update(images[0])]), joints, 0.02)
        for place in ("cuda", "cpu"))
    assert set(vars(got)) == set(vars(want))
    assert got.any.dtype == bool and (got.any == want.any).mean() > 0.95
    for name, tolerance in (("volume", 1e-8), ("wrench", 1e-8), ("joint_torque", 1e-8), ("clearance", 1e-5), ("unseen", 0.01)):
        assert np.abs(getattr(got, name) - getattr(want, name)).max() < tolerance, name
    assert (want.unseen > 0).any() and (want.volume > 0).any()


@pytest.mark.parametrize("is_given", [False, True])
def test_one_image_that_a_side_stream_still_writes(scene, library, is_given):
    """Without `stream` the array library orders the work, with it the stream does. Other threads continue."""
    camera, images, *_ = scene
    sensor = palpate.Sensor(camera, place="cuda")
    late, image = library.on_gpu(images[0]), library.on_gpu(images[0] * 0 + 3)
    sensor.update(image)  # takes the memory
    library.wait()
    stream = library.stream()
    with library.within(stream):
        library.keep_busy()
        library.write(image, late)
        surface = sensor.update(image, **({"stream": stream} if is_given else {}))
    points = library.taken(surface.points_C)
    expected = palpate.Sensor(camera).update(images[0]).points
    assert np.array_equal(np.isfinite(points), np.isfinite(expected))
    assert np.nanmax(np.abs(points - expected)) < 1e-5


def test_other_threads_go_on_while_an_image_is_written(scene, library):
    camera, images, *_ = scene
    sensor, image = palpate.Sensor(camera, place="cuda"), library.on_gpu(images[0])
    sensor.update(image)
    library.wait()
    ticks, is_over = [0], threading.Event()

    def count():
        while not is_over.wait(0.001):
            ticks[0] += 1

    counter = threading.Thread(target=count)
    counter.start()
    library.keep_busy()  # in the default stream
    before = ticks[0]
    sensor.update(image)
    during = ticks[0] - before
    is_over.set()
    counter.join()
    assert during > 3


def test_work_is_done_in_the_stream_of_the_caller(cube, scene, library):
    """Work that is pending in the stream at the call is done first."""
    camera, images, poses, which = scene
    sensor, contact = palpate.Sensor(camera, place="cuda"), palpate.Contact(cube, place="cuda")
    some, where, number = library.on_gpu(images * 0), library.on_gpu(poses * 0), library.on_gpu(which)
    late_images, late_poses = library.on_gpu(images), library.on_gpu(poses)
    out, there = answers(library)
    fields = sensor.update_batch(library.on_gpu(images))  # takes the memory
    library.wait()
    stream = library.stream()
    with library.within(stream):
        library.keep_busy()
        library.write(some, late_images)
        library.write(where, late_poses)
        sensor.update_batch(some, out=fields, stream=stream)
        contact.measure_batch(fields, where, surface_of_pose=number, out=out, stream=stream)
    library.wait()
    assert_same(there, on_cpu(cube, scene), library)


def test_captured_in_a_graph(cube, scene, library):
    """Images to fields to answers, replayed with new images and poses in the same arrays."""
    camera, images, poses, which = scene
    sensor, contact = palpate.Sensor(camera, place="cuda"), palpate.Contact(cube, place="cuda")
    some, where, number = library.on_gpu(images + 1), library.on_gpu(poses), library.on_gpu(which)
    out, there = answers(library)
    fields = sensor.update_batch(some)
    contact.measure_batch(fields, where, surface_of_pose=number, out=out)
    library.wait()

    def work(stream):
        sensor.update_batch(some, out=fields, stream=stream)
        contact.measure_batch(fields, where, surface_of_pose=number, out=out, stream=stream)

    replay = library.captured(work)
    for shift in (0.0, 0.005):
        library.write(some, library.on_gpu(images + np.float32(shift)))
        library.write(where, library.on_gpu(poses))
        library.wait()
        replay()
        library.wait()
        assert_same(there, on_cpu(cube, scene, shift), library)


@pytest.mark.parametrize("method", ["field", "weighted", "simplified", "graph"])
def test_a_contact_on_the_cpu_refuses_a_surface_on_the_gpu(cube, scene, method):
    camera, images, poses, _ = scene
    surface = palpate.Sensor(camera, place="cuda").update(images[0])
    with pytest.raises(palpate.Error, match="surface in the memory of GPU 0 was given to a contact on the CPU"):
        palpate.Contact(cube, method).measure(surface, poses[0])


def test_what_a_gpu_cannot_take(cube, scene, library):
    camera, images, poses, which = scene
    sensor, contact = palpate.Sensor(camera, place="cuda"), palpate.Contact(cube, place="cuda")
    fields = sensor.update_batch(images)
    with pytest.raises(ValueError, match="poses: has to be float64, row by row"):
        contact.measure_batch(fields, library.on_gpu(poses.astype(np.float32)), surface_of_pose=library.on_gpu(which))
    with pytest.raises(ValueError, match="surface_of_pose: has to be on the GPU"):
        contact.measure_batch(fields, library.on_gpu(poses), surface_of_pose=which)
    with pytest.raises(ValueError, match="force: is elsewhere"):
        palpate.Batch(volume=library.on_gpu(np.zeros(3)), force=np.zeros((3, 3)))
    with pytest.raises(palpate.Error, match="GPU"):
        palpate.Contact(cube).measure_batch(palpate.Sensor(camera).update_batch(images), library.on_gpu(poses),
                                            surface_of_pose=library.on_gpu(which))
