import re
import sys
import tracemalloc
import zipfile

import numpy as np
import pytest
from PIL import Image

from sci_lightning.data.reader import find_clips, read_clip
from sci_lightning.errors import BadInput
from tests import hostile_files

COLOURS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [10, 200, 90]], dtype=np.uint8)
LUMAS = [76, 150, 29, 255, 131]  # 0.299 R + 0.587 G + 0.114 B, rounded


def save_images(folder, frames, ending="png"):
    folder.mkdir(parents=True, exist_ok=True)
    for i, frame in enumerate(frames):
        Image.fromarray(frame).save(folder / f"{i}.{ending}")


def save_video(path, frames):
    """Lossless up to the rounding of YUV; frames are uint8 (H, W, 3)."""
    av = pytest.importorskip("av", reason="PyAV is not installed")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "0", "preset": "ultrafast"})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv444p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def test_npz_is_read_unchanged(tmp_path, noise):
    np.savez(tmp_path / "a.npz", frames=noise())
    clip = read_clip(tmp_path / "a.npz")
    assert clip.dtype == np.uint8
    np.testing.assert_array_equal(clip, noise())


def test_npz_prefers_the_key_frames_then_the_first_array_that_is_a_video(tmp_path, noise):
    np.savez(tmp_path / "key.npz", other=noise(seed=1), frames=noise())
    np.savez_compressed(tmp_path / "first.npz", times=np.arange(12), clip=noise(), other=noise(seed=1))
    np.testing.assert_array_equal(read_clip(tmp_path / "key.npz"), noise())
    np.testing.assert_array_equal(read_clip(tmp_path / "first.npz"), noise())


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_npz_of_floats_is_scaled_to_8_bits(tmp_path, noise, dtype):
    np.savez(tmp_path / "a.npz", frames=(noise() / 255).astype(dtype))
    np.testing.assert_array_equal(read_clip(tmp_path / "a.npz"), noise())


def test_colours_become_full_range_luma(tmp_path):
    frames = np.broadcast_to(COLOURS[None, None], (2, 4, 5, 3))
    np.savez(tmp_path / "bytes.npz", frames=frames)
    np.savez(tmp_path / "floats.npz", frames=frames / 255)
    save_images(tmp_path / "images", np.ascontiguousarray(frames))
    for name in ("bytes.npz", "floats.npz", "images"):
        np.testing.assert_array_equal(read_clip(tmp_path / name), np.broadcast_to(LUMAS, (2, 4, 5)))


def test_jpeg_luma_agrees_with_that_of_its_colours(tmp_path):
    frames = [np.repeat(np.repeat(COLOURS[None], 16, 0), 16, 1)] * 2
    save_images(tmp_path / "images", frames, "jpg")
    assert np.abs(read_clip(tmp_path / "images")[:, :, 8::16].astype(int) - LUMAS).max() <= 2


@pytest.mark.parametrize("ending", ["png", "tif", "bmp", "TIFF"])
def test_images_are_read_in_natural_order(tmp_path, noise, ending):
    save_images(tmp_path / "a", noise(12), ending)  # 0, 1, ..., 10, 11: not the order of the alphabet
    np.testing.assert_array_equal(read_clip(tmp_path / "a"), noise(12))


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_video_becomes_full_range_luma(tmp_path, ending):
    frames = [np.repeat(np.repeat(np.roll(COLOURS, t, 0)[None], 32, 0), 32, 1) for t in range(5)]
    save_video(tmp_path / f"a.{ending}", frames)
    clip = read_clip(tmp_path / f"a.{ending}")
    assert clip.shape == (5, 32, 160)
    for t in range(5):
        assert np.abs(clip[t, :, 16::32].astype(int) - np.roll(LUMAS, t)).max() <= 3


def test_video_without_pyav_tells_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    (tmp_path / "a.mp4").touch()
    with pytest.raises(BadInput, match=r"a\.mp4: .*sci-lightning\[video\]"):
        read_clip(tmp_path / "a.mp4")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.1, 1.5, 255])
def test_values_out_of_range_are_refused(tmp_path, bad):
    frames = np.full((3, 4, 5), 0.5)
    frames[1, 2, 3] = bad
    np.savez(tmp_path / "a.npz", frames=frames)
    with pytest.raises(BadInput, match=r"a\.npz, frame 1: values .*\[0, 1\]"):
        read_clip(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"frames": np.zeros((3, 4, 5), np.int16)}, "frame 0: values of type int16; expected uint8"),
        ({"frames": np.zeros((4, 5), np.uint8), "x": np.zeros((3, 4, 5))}, r"\['frames'\]; expected one of"),
        ({"x": np.zeros((4, 5)), "y": np.zeros((3, 4, 5, 4))}, r"\['x', 'y'\]; expected one of \(T, H, W\)"),
        ({"frames": np.zeros((0, 4, 5), np.uint8)}, "holds no frames"),
        ({"frames": np.array([[[{}]]])}, "cannot be read"),  # would need pickle
    ],
)
def test_npz_that_is_no_video_is_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(BadInput, match=rf"a\.npz.*{message}"):
        read_clip(tmp_path / "a.npz")


def test_truncated_files_are_refused(tmp_path, noise):
    np.savez(tmp_path / "a.npz", frames=noise())
    save_images(tmp_path / "images", noise(3))
    save_video(tmp_path / "a.mp4", [np.repeat(frame[..., None], 3, 2) for frame in noise(3)])
    for file, name in (("a.npz", "a.npz"), ("images/1.png", "images"), ("a.mp4", "a.mp4")):
        whole = (tmp_path / file).read_bytes()
        (tmp_path / file).write_bytes(whole[: len(whole) // 2])
        with pytest.raises(BadInput, match=rf"{file}: cannot be read \(.*complete\?$") as caught:
            read_clip(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_frames_of_unequal_size_are_refused(tmp_path, noise):
    save_images(tmp_path / "a", [*noise(2), *noise(1, 40, 50)])
    with pytest.raises(BadInput, match=r"a: frame 2 .*\(40, 50\).*\(40, 48\)"):
        read_clip(tmp_path / "a")


def test_images_of_16_bits_are_refused(tmp_path, noise):
    save_images(tmp_path / "a", noise(2).astype(np.uint16) * 257)
    with pytest.raises(BadInput, match=r"0\.png: .* I;16; .*8-bit"):
        read_clip(tmp_path / "a")


def test_what_is_no_clip_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").touch()
    with pytest.raises(BadInput, match="empty: holds no frames"):
        read_clip(tmp_path / "empty")
    with pytest.raises(BadInput, match=r"notes\.txt: not a clip; expected"):
        read_clip(tmp_path / "notes.txt")
    with pytest.raises(BadInput, match=r"absent\.npz: cannot be read"):
        read_clip(tmp_path / "absent.npz")


def test_find_clips_lists_a_tree_in_natural_order(tmp_path, noise):
    for name in ("clip10.npz", "clip2.npz", "b/clip1.MP4", "._clip2.npz", ".cache/x.npz", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    save_images(tmp_path / "a" / "deep", noise(2))
    save_images(tmp_path / "cover", noise(1))  # a single picture is no clip
    result = [clip.relative_to(tmp_path).as_posix() for clip in find_clips(tmp_path)]
    assert result == ["a/deep", "b/clip1.MP4", "clip2.npz", "clip10.npz"]
    assert find_clips(str(tmp_path / "clip2.npz")) == [tmp_path / "clip2.npz"]


def test_find_clips_tells_what_it_looks_for(tmp_path):
    with pytest.raises(BadInput, match=r"holds no clip; .*\.npz .*\.mp4.*images"):
        find_clips(tmp_path)
    with pytest.raises(BadInput, match=r"absent: no such file"):
        find_clips(tmp_path / "absent")


def test_real_clips_are_read(shared):
    clips = find_clips(shared / "train")
    assert len(clips) == 48
    clip = read_clip(clips[0])
    assert len(clip) >= 30
    assert min(clip.shape[1:]) >= 256


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "webm", "avi"])
def test_a_video_that_was_cut_off_is_refused(tmp_path, noise, ending):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    path = tmp_path / f"a.{ending}"
    # for the web: what says how long the video is stands before the frames
    with av.open(str(path), "w", options={"movflags": "faststart"} if ending in ("mp4", "mov") else {}) as container:
        stream = container.add_stream("libvpx-vp9" if ending == "webm" else "libx264", rate=25)
        stream.height, stream.width, stream.pix_fmt = 40, 48, "yuv420p"
        for frame in noise(30):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.stack([frame] * 3, -1), format="rgb24")))
        container.mux(stream.encode())
    assert len(read_clip(path)) == 30
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.6 * len(whole))])
    with pytest.raises(BadInput, match=rf"a\.{ending}: (is cut off \(|cannot be read)"):
        read_clip(path)
    path.write_bytes(whole + b"appended by a program")
    assert len(read_clip(path)) == 30


READ = """
from sci_lightning.data.reader import read_clip as read
"""


def npz(path, shape, mebibytes, name="frames"):
    """A zip bomb: an array of zeros, whose header says ``shape``."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(f"{name}.npy", "w") as f,
    ):
        np.lib.format.write_array_header_1_0(f, {"descr": "|u1", "fortran_order": False, "shape": shape})
        for _ in range(mebibytes):
            f.write(bytes(2**20))
    return path


def test_npz_that_declares_too_much(tmp_path):
    line = hostile_files.refusal(READ, npz(tmp_path / "a.npz", (2**20, 2**10, 2**10), 1))
    assert re.search(r"a\.npz: 'frames' .*\(1048576, 1024, 1024\) .*1099511627776 bytes, .* 1048576", line)
    line = hostile_files.refusal(READ, npz(tmp_path / "a.npz", (2**9, 2**10), 600))
    assert re.search(r"a\.npz: .*\['frames'\]; expected one of", line)


def test_other_arrays_of_an_npz_are_not_inflated(tmp_path):
    with (
        zipfile.ZipFile(npz(tmp_path / "a.npz", (300, 2**20), 300, "huge"), "a") as archive,
        archive.open("a.npy", "w") as f,
    ):
        np.save(f, np.zeros((2, 3, 4), np.uint8))
    tracemalloc.start()
    assert read_clip(tmp_path / "a.npz").shape == (2, 3, 4)
    assert tracemalloc.get_traced_memory()[1] < 2**24
    tracemalloc.stop()


def test_pictures_of_other_formats_are_refused(tmp_path):
    """Pillow goes by the content and would hand PostScript to an interpreter."""
    for number in range(2):
        page = "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n%%EOF\n"
        (tmp_path / f"{number}.png").write_text(page)
    with pytest.raises(BadInput, match="cannot identify image file"):
        read_clip(tmp_path)


@pytest.mark.parametrize("name", ["clip.mp4", "clip.mov", "clip.avi"])
def test_playlists_are_not_followed(tmp_path, name):
    """FFmpeg goes by the content and would read other files, or fetch them."""
    pytest.importorskip("av")
    save_video(tmp_path / "other.mkv", np.zeros((8, 16, 16, 3), np.uint8))
    lines = ("#EXTM3U", "#EXT-X-TARGETDURATION:10", "#EXTINF:10,", str(tmp_path / "other.mkv"), "#EXT-X-ENDLIST", "")
    (tmp_path / name).write_text("\n".join(lines))
    with pytest.raises(BadInput, match="cannot be read"):
        read_clip(tmp_path / name)
