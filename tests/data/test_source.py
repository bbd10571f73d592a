"""What every source keeps to, whatever it is made of."""

import multiprocessing
import subprocess
import sys

import pytest
import torch

from sci_lightning.data import Davis, Folder, Source, Synthetic

CLIPS = (0, 1, 5, 1234567)


@pytest.fixture(params=[Synthetic, Folder, Davis])
def make(request, tmp_path):
    """Builds the same source anew at each call."""
    if request.param is Synthetic:
        return lambda: Synthetic(4, (32, 40), (16, 16), seed=3)
    root = request.getfixturevalue("tree" if request.param is Folder else "davis")
    return lambda: request.param(root, 4, (32, 40), (16, 16), seed=3, store=tmp_path / "store")


def put(queue, make):
    torch.set_num_threads(1)
    queue.put([make().clips()[i].numpy() for i in CLIPS])


def test_it_is_a_source(make):
    assert isinstance(make(), Source)


def test_clips_are_a_pure_function_of_seed_and_index(make):
    first, second = make().clips(), make().clips()
    assert len(first) == len(second) > 0
    for i in reversed(CLIPS):
        assert torch.equal(first[i], second[i])
        assert torch.equal(first[i], first[i])
    assert not torch.equal(first[0], first[1])


def test_clips_are_the_same_in_another_process(make):
    queue = multiprocessing.get_context("fork").SimpleQueue()
    process = multiprocessing.get_context("fork").Process(target=put, args=(queue, make))
    process.start()
    elsewhere = queue.get()
    process.join()
    clips = make().clips()
    assert all(torch.equal(clips[i], torch.from_numpy(there)) for i, there in zip(CLIPS, elsewhere, strict=True))


def test_clips_leave_the_global_random_state_alone(make):
    clips = make().clips()
    before = torch.get_rng_state()
    clips[0]
    assert torch.equal(torch.get_rng_state(), before)


def test_clips_have_shape_type_and_range(make):
    clips = make().clips()
    for i in range(20):
        assert clips[i].shape == (4, 16, 16)
        assert clips[i].dtype == torch.float32
        assert 0 <= clips[i].min() < clips[i].max() <= 1


def test_scenes_have_shape_type_range_and_names_of_their_own(make):
    scenes = make().scenes()
    assert scenes
    for scene, same in zip(scenes, make().scenes(), strict=True):
        video = torch.stack(list(scene.video))
        assert video.shape[1:] == (4, 32, 40)
        assert video.dtype == torch.float32
        assert 0 <= video.min() < video.max() <= 1
        assert torch.equal(video, torch.stack(list(same.video)))
    assert len({scene.name for scene in scenes}) == len(scenes)


def test_the_package_stands_alone():
    script = (
        "import sys, sci_lightning.data, sci_lightning.data.loader\n"
        "print(*{'lightning', 'hydra', 'av', 'h5py', 'skimage', 'scipy', 'PIL'} & set(sys.modules))"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == ""
