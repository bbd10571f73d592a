import pickle

import pytest
import torch

from sci_lightning.data import Clips, Folder, Scene
from sci_lightning.data.loader import ClipLoader, EpochSampler, SceneSnapshots, scene_loader
from sci_lightning.errors import BadInput


class Numbers(Clips):
    """Clips that tell their index and the threads that they are made on."""

    def __len__(self):
        return 10

    def __getitem__(self, index):
        return torch.tensor([index, torch.get_num_threads()])


def test_batches_follow_the_formula():
    sampler = EpochSampler(10, 3)
    assert len(sampler) == 3
    assert list(sampler) == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    sampler.set_epoch(2)
    assert list(sampler) == [[20, 21, 22], [23, 24, 25], [26, 27, 28]]


@pytest.mark.parametrize("epoch", [0, 3])
def test_ranks_share_an_epoch_without_overlap(epoch):
    drawn = []
    for rank in range(3):
        sampler = EpochSampler(26, 4, rank=rank, world_size=3)
        sampler.set_epoch(epoch)
        assert len(sampler) == 2
        drawn.append(list(sampler))
    together = [i for batches in zip(*drawn, strict=True) for batch in batches for i in batch]
    assert together == list(range(26 * epoch, 26 * epoch + 24))


def test_the_same_clips_are_seen_on_any_number_of_processes():
    one = list(EpochSampler(24, 6))
    two = [EpochSampler(24, 3, rank=rank, world_size=2) for rank in range(2)]
    assert [a + b for a, b in zip(*two, strict=True)] == one


def test_only_the_resumed_epoch_begins_late():
    sampler = EpochSampler(12, 3, rank=1, world_size=2)
    whole = list(sampler)
    sampler.start_at(0, 1)
    assert len(sampler) == 2
    assert list(sampler) == whole[1:]
    sampler.set_epoch(1)
    assert list(sampler) == [[first + 12 for first in batch] for batch in whole]
    sampler.start_at(2, 2)
    assert list(sampler) == []


@pytest.mark.parametrize(("length", "batch", "world"), [(3, 4, 1), (7, 4, 2), (5, 0, 1)])
def test_an_epoch_without_a_whole_batch_is_refused(length, batch, world):
    with pytest.raises(BadInput, match=rf"batch_size={batch} on {world} process.*{length} clips"):
        EpochSampler(length, batch, world_size=world)


@pytest.mark.parametrize("workers", [0, 2])
def test_loader_gives_batches_epoch_after_epoch(workers):
    loader = ClipLoader(Numbers(), 4, workers=workers)
    assert len(loader) == 2
    for epoch in range(2):
        loader.epoch_sampler.set_epoch(epoch)
        batches = torch.stack(list(loader))
        assert batches[..., 0].tolist() == [[10 * epoch + i for i in range(4)], [10 * epoch + i for i in range(4, 8)]]
        if workers:
            assert (batches[..., 1] == 1).all()


def test_workers_load_what_the_main_process_would(tree, tmp_path):
    clips = Folder(tree, 4, (32, 40), (16, 16), store=tmp_path / "store").clips()
    for batch, indices in zip(ClipLoader(clips, 3, workers=2), EpochSampler(len(clips), 3), strict=True):
        assert torch.equal(batch, torch.stack([clips[i] for i in indices]))
    assert torch.equal(pickle.loads(pickle.dumps(clips))[2], clips[2])


@pytest.mark.parametrize("workers", [0, 1])
def test_an_interrupted_epoch_is_taken_up(workers):
    loader = ClipLoader(Numbers(), 2, workers=workers)
    loader.epoch_sampler.start_at(3, 2)
    assert [batch[:, 0].tolist() for batch in loader] == [[34, 35], [36, 37], [38, 39]]
    loader.epoch_sampler.set_epoch(4)
    assert [batch[:, 0].tolist() for batch in loader] == [[i, i + 1] for i in range(40, 50, 2)]


def test_scenes_come_as_single_snapshots_in_order():
    videos = [torch.rand(n, 2, 4, 5) for n in (3, 1, 2)]
    scenes = [Scene(str(i), video) for i, video in enumerate(videos)]
    loaded = list(scene_loader(scenes))
    assert [index.item() for index, _ in loaded] == [0, 0, 0, 1, 2, 2]
    assert torch.equal(torch.cat([video for _, video in loaded]), torch.cat(videos))
    index, video = next(iter(scene_loader(scenes, 4)))
    assert index.tolist() == [0, 0, 0, 1]
    assert video.shape == (4, 2, 4, 5)


def test_the_sampler_is_found_where_trainers_look_for_it():
    loader = ClipLoader(Numbers(), 4)
    assert loader.batch_sampler is loader.epoch_sampler
    assert loader.epoch_sampler.sampler is loader.epoch_sampler


def test_ranks_share_the_snapshots():
    scenes = [Scene("a", torch.arange(7.0).reshape(7, 1, 1, 1))]
    shares = [[v.item() for _, v in scene_loader(scenes, rank=rank, world_size=3)] for rank in range(3)]
    assert shares == [[0, 3, 6], [1, 4], [2, 5]]


def test_snapshots_know_their_scenes_on_every_rank():
    scenes = [Scene(name, torch.rand(2, 3, 4, 5)) for name in ("a", "b")]
    snapshots = SceneSnapshots(scenes, rank=1, world_size=4)
    assert len(snapshots) == 1
    assert snapshots.names == ["a", "b"]
    assert torch.equal(snapshots.first(1), scenes[1].video[0])
