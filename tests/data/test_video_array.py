import h5py
import numpy as np
import pytest
from scipy.io import savemat

from sci_lightning.data.video_array import read_video_array
from sci_lightning.errors import BadInput


def save_5(path, **arrays):
    savemat(path, {key: np.moveaxis(array, 0, -1) for key, array in arrays.items()}, do_compression=True)


def save_73(path, **arrays):
    """As MATLAB 7.3 does: its own header in the first 512 bytes, then HDF5 with the axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, array in arrays.items():
            file[key] = array.transpose(0, 2, 1)  # (F, W, H)
        file.create_group("#refs#")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("save", [save_5, save_73])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_both_formats_and_all_types(tmp_path, noise, save, dtype):
    save(tmp_path / "a.mat", orig=noise().astype(dtype), mask=noise(2))
    video = read_video_array(tmp_path / "a.mat", "orig")
    assert video.dtype == np.float32
    np.testing.assert_allclose(video, noise() / 255, atol=1e-7)


@pytest.mark.parametrize("save", [save_5, save_73])
def test_values_up_to_one_count_as_scaled(tmp_path, noise, save):
    save(tmp_path / "a.mat", orig=noise() / 255)
    np.testing.assert_allclose(read_video_array(tmp_path / "a.mat", "orig"), noise() / 255, atol=1e-7)


@pytest.mark.parametrize("save", [save_5, save_73])
def test_a_missing_key_is_named_with_those_there_are(tmp_path, noise, save):
    save(tmp_path / "a.mat", mask=noise(), meas=noise())
    with pytest.raises(BadInput, match=r"a\.mat: .*'orig'; .*m\w+ \(.*\), m\w+ \("):
        read_video_array(tmp_path / "a.mat", "orig")


@pytest.mark.parametrize("save", [save_5, save_73])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1, 256])
def test_values_out_of_range_are_refused(tmp_path, noise, save, bad):
    frames = noise().astype(float)
    frames[1, 2, 3] = bad
    save(tmp_path / "a.mat", orig=frames)
    with pytest.raises(BadInput, match=r"a\.mat: 'orig' .*expected 0 to 255"):
        read_video_array(tmp_path / "a.mat", "orig")


@pytest.mark.parametrize("save", [save_5, save_73])
def test_truncated_files_are_refused(tmp_path, noise, save):
    save(tmp_path / "a.mat", orig=noise())
    whole = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput, match=r"a\.mat: not a readable (\.mat|HDF5) file") as caught:
        read_video_array(tmp_path / "a.mat", "orig")
    assert "\n" not in str(caught.value)


def test_what_is_no_video_is_refused(tmp_path):
    savemat(tmp_path / "flat.mat", {"orig": np.zeros((4, 5))})
    savemat(tmp_path / "text.mat", {"orig": "frames"})
    for name in ("flat", "text"):
        with pytest.raises(BadInput, match=rf"{name}\.mat: .*3 dimensions, found"):
            read_video_array(tmp_path / f"{name}.mat", "orig")
    with pytest.raises(BadInput, match=r"absent\.mat: no such file"):
        read_video_array(tmp_path / "absent.mat", "orig")
