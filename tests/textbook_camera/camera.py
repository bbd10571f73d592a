"""The camera as its builder would describe it: every number that light meets on the way, in the builder's own units.

Lengths are micrometres on the sensor, angles radians, times slots of the exposure, light a part of what fills the
converter's range. The default of every field is the ideal part, so that a deviation is a field that differs. ``x``
goes with the columns to the right, ``y`` with the rows downwards, both from the optical axis in the field's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

PIXEL_UM = 5.5
"""Pitch of the sensor's pixels in micrometres."""
MIRROR_UM = 13.68
"""Pitch of the modulator's mirrors in micrometres; the relay images a mirror onto a pixel."""
RELAY_MAGNIFICATION = PIXEL_UM / MIRROR_UM
SAMPLES = 4
"""Samples of the continuous image along a pixel's side."""
MARGIN = 10
"""Pixels of the world beyond each edge of the field."""
MIRROR_MARGIN = 16
"""Mirrors beyond each edge of the field; the captures file never says what they show."""
RESET_BLOCKS = 16
"""Blocks of rows of mirrors that a phased reset moves one after the other."""
SLOTS = 8
"""Patterns in one exposure."""
STEPS = 4
"""Moments in a slot at which a moving target is looked at."""


@dataclass(frozen=True)
class Colour:
    """One wavelength of the source: its share of the light and what the relay does to it, relative to the mean."""

    share: float = 1.0
    magnification_error: float = 0.0
    dispersion_um: float = 0.0


@dataclass(frozen=True)
class Camera:
    """All parts of one camera, in the order in which light meets them; the defaults are the ideal camera."""

    # Modulator
    fill_factor: float = 1.0  # part of a mirror's cell that reflects
    off_light: float = 0.0  # light from a mirror that is off, relative to one that is on: one over the contrast
    level_exponent: float = 1.0  # reflected = commanded ** exponent
    retention: float = 0.0  # part of the last slot's state that a cell keeps
    slots_late: int = 0  # whole slots by which the patterns come late
    orientation: str = ""  # how the patterns lie on the modulator: flip_lr, flip_ud, rot180 or transpose
    planes: tuple[int, ...] = ()  # order in which the binary planes of a 4-bit level are shown, by their exponents
    swapped: tuple[int, int] | None = None  # two patterns exchanged in the modulator's memory
    stuck: float = 0.0  # part of the mirrors that stay off
    # Relay: modulator to image
    decentre_um: tuple[float, float] = (0.0, 0.0)
    roll_rad: float = 0.0  # from +x towards +y
    magnification_error: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)  # change of the magnification from the axis to the right and lower edges
    radial: float = 0.0  # r goes to r (1 + radial r^2 / R^2), R from the axis to the field's corner
    colours: tuple[Colour, ...] = (Colour(),)
    relay_sigma_um: float = 0.0
    # Exposure
    duty: float = 1.0  # part of a slot, in its middle, during which the source is on
    late_slots: float = 0.0  # the patterns' clock behind the sensor's
    reset_slots: float = 0.0  # between the first and the last block of mirrors
    shutter_slots: float = 0.0  # between the first and the last row of the sensor
    flicker_depth: float = 0.0
    flicker_cycles: float = 1.0  # per exposure
    flicker_phase_rad: float = 0.0
    drift: float = 0.0  # relative change of the source from the first capture to the last
    jitter: float = 0.0  # standard deviation of a capture's exposure, relative
    source: float = 1.0  # power of the source, relative to what an ideal modulator needs
    # Lens: image to sensor
    lens_sigma_um: tuple[float, float] = (0.0, 0.0)  # on the axis, along y and along x
    corner_sigma_um: float = 0.0  # added to both at the field's corner, growing with the radius squared
    edge_sigma_um: float = 0.0  # added at the right edge and taken away at the left: a tilted sensor
    vignetting: float = 0.0  # light lost in the field's corner
    cosine_law: bool = False  # cos^4 in place of a loss that grows with the radius squared
    uneven: float = 0.0  # standard deviation over the field of the source's smooth unevenness
    glare: float = 0.0
    ghost: float = 0.0
    # Sensor
    quantum_efficiency: float = 1.0  # relative to the datasheet
    full_scale_e: float = 10_000.0
    pixel_gain: float = 0.0  # photo-response non-uniformity (PRNU), standard deviation
    crosstalk: float = 0.0  # part of a pixel's charge that each of its four neighbours collects
    image_lag: float = 0.0  # part of the last capture's charge that is read out with this one
    well: float = 1.25  # charge that fills a pixel, in parts of full scale
    blooming: float = 0.0  # part of the charge above the well that runs into the two neighbours of the column
    response_exponent: float = 1.0
    knee: tuple[float, float] | None = None  # signal from which on the response is flatter, and its slope there
    cubic: float = 0.0  # response s + cubic (s^3 - s)
    pedestal: float = 0.0  # in parts of full scale, as are the next four
    pixel_offset: float = 0.0  # dark-signal non-uniformity (DSNU), standard deviation
    column_offset: float = 0.0
    row_offset: float = 0.0
    stray_spot: float = 0.0  # peak of a spot of stray light that no pattern modulates
    hot: float = 0.0  # part of the pixels
    read_noise_dn: float = 2.0
    converter_bits: int = 10
    # Targets: what stands before the camera, against what the file says
    stage: bool = False  # scenes move all the time on a stage; otherwise a fast display shows one frame a slot
    target_shift_um: tuple[float, float] = (0.0, 0.0)
    target_roll_rad: float = 0.0
    target_magnification_error: float = 0.0
    target_sigma_um: float = 0.0
    target_exponent: float = 1.0
    print_error: float = 0.0  # standard deviation of the smooth error, and of the error of each patch, relative
    misplacement_um: float = 0.0  # standard deviation of a target's place along x and along y


@dataclass(frozen=True)
class Shot:
    """One capture of the plan: what it is for, the pattern of each slot, the target, and the light's scale."""

    kind: str
    sequence: tuple[int, ...]
    target: str
    aperture: float


@dataclass(frozen=True)
class Datasheet:
    """What is known of the camera: bits, electrons at full scale, read noise in DN, and 16 levels a pattern or two."""

    bit_depth: int = 10
    full_well_e: float = 10_000.0
    read_noise_dn: float = 2.0
    gray: bool = False

    @property
    def full_scale_dn(self) -> int:
        """The largest value of the converter."""
        return 2**self.bit_depth - 1


def plan(textures: int = 4, moving: int = 8) -> list[Shot]:
    """Return the 34 captures of one calibration: darks, flats, patterns, static textures and moving scenes.

    Patterns ``0`` to ``SLOTS - 1`` code; ``SLOTS`` is all off, ``SLOTS + 1`` all on.
    """
    off, on, coded = (SLOTS,) * SLOTS, (SLOTS + 1,) * SLOTS, tuple(range(SLOTS))
    shots = [Shot("dark", sequence, "black", 1.0 / SLOTS) for sequence in (off, coded)]
    shots += [Shot("flat", on, f"gray {level:g}", 1.0 / SLOTS) for level in (0.1, 0.25, 0.4, 0.6, 0.8)]
    shots += [Shot("flat", on, "gray 0.9", 1.3 / SLOTS), Shot("flat", off, "gray 0.9", 1.0)]
    shots += [Shot("pattern", (pattern,) * SLOTS, "gray 0.8", 1.1 / SLOTS) for pattern in (0, 2, 3, 5, 7)]
    for slot in (0, 3, 4, 7):
        alone = tuple(slot if this == slot else SLOTS for this in range(SLOTS))
        shots.append(Shot("pattern", alone, "gray 0.8", 1.0))
    shots += [Shot("static", on, f"texture {index}", 1.0 / SLOTS) for index in range(textures - 1)]
    shots += [Shot("static", coded, f"texture {index}", 0.24) for index in range(textures)]
    shots += [Shot("static", coded, "gray 0.8", 0.2)]
    shots += [Shot("dynamic", coded, f"moving {index}", 0.24) for index in range(moving)]
    return shots
