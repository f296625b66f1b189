"""Direction finding, simulated flights and suites of Foxhound, in the Rust of its firmware.

Tables are dictionaries of NumPy arrays, one for each column: ``pandas.DataFrame(table)`` takes them as they are. What is
refused is a ``ValueError`` that names the key, its value and the range.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias, final

from numpy.typing import ArrayLike, NDArray

Table: TypeAlias = dict[str, NDArray[Any]]
File: TypeAlias = str | PathLike[str]

__all__ = ["Array", "Suite", "bearings", "fly"]

@final
class Array:
    """An array of antennas and its receiver: the keys of an array file."""

    def __init__(
        self,
        *,
        wavelength_m: float,
        sample_rate_hz: float,
        side_m: float | None = None,
        antennas_m: ArrayLike | None = None,
        tone_hz: float | None = None,
        tone_band_hz: Sequence[float] | None = None,
        skew_s: Sequence[float] | None = None,
        require_calibration: bool = False,
        calibration: Mapping[str, Any] | None = None,
        sigma_floor_deg: float | None = None,
        switch: Mapping[str, Any] | None = None,
    ) -> None: ...
    @classmethod
    def from_file(cls, path: File) -> Array:
        """Reads an array file (TOML)."""
    @property
    def toml(self) -> str:
        """The text of its array file."""

def bearings(
    array: Array,
    samples: ArrayLike | File,
    *,
    looks: int = 1,
    emitter: ArrayLike | None = None,
    yaw_rad: ArrayLike | None = None,
    independent: bool = False,
) -> Table:
    """The bearings in a recording, as ``foxhound bearing`` finds them: an entry for each ``looks`` frames."""

def fly(
    scenario: File | dict[str, Any] | None = None,
    *,
    seed: int = 1,
    snr_db: float | None = None,
    planner: str = "foxhound",
    params: dict[str, float] | None = None,
) -> dict[str, Any]:
    """Flies one mission: what ``foxhound fly --json`` prints, with the tables ``path`` and ``obstacles``."""

@final
class Suite:
    """A suite file, or a dictionary with its keys: maps with start/goal pairs, each of which is one flight."""

    def __init__(self, suite: File | dict[str, Any]) -> None: ...
    def run(
        self,
        *,
        seed: int = 1,
        jobs: int | None = None,
        planner: str = "foxhound",
        only: Sequence[int] = (),
        pairs: int | None = None,
        snr_db: float | None = None,
        bearing_sigma_deg: float | None = None,
    ) -> dict[str, Any]:
        """Flies it: what ``foxhound suite --json`` prints, with the table ``flights``."""
