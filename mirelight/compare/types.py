"""What a comparison takes and gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, ToneCurve

Bool = NDArray[np.bool_]
RegionName = Literal["all", "covered", "silhouette"]
Verdict = Literal["identical", "noise", "difference", "unknown"]

NOISE_MARGIN = 1.5  # a mean squared difference up to this multiple of the expected one is called noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """One side of a pair. H, W: rows and columns."""

    file: Path
    rgb: F32  # (H, W, 3) premultiplied; linear light, or display values where `linear` is False
    linear: bool
    alpha: F32  # (H, W) 1 where the file has none
    coverage: F32 | None = None  # (H, W) of the proxy, where the file says
    depth: F32 | None = None  # (H, W) along the view axis, 0 where nothing is
    noise: F32 | None = None  # (H, W, 3) standard deviation of the linear rgb, where the file says
    settings: Mapping[str, Any] = field(default_factory=dict)  # what made it, as the file tells

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the pictures."""
        return self.rgb.shape[0], self.rgb.shape[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two files to compare, and a file whose white part counts."""

    name: str
    reference: Path
    test: Path
    mask: Path | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that the comparison reads."""
        return (self.reference, self.test, *(() if self.mask is None else (self.mask,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairing:
    """What is compared, and a line for each frame that is not, for lack of a partner."""

    pairs: tuple[Pair, ...]
    without_test: tuple[str, ...] = ()
    without_reference: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareSettings:
    """How two pictures are made comparable. The tone curve and exposure apply to linear pictures alone."""

    exposure: float = 0.0  # stops
    tone: ToneCurve = "none"
    transfer: Literal["auto", "srgb", "power"] = "auto"  # display curve; power: 1 / 2.2, the real-time engine's; auto:
    # power where a side says that it is the engine's or follows it, else sRGB
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # display values, behind transparent pixels
    premultiplied: bool = False  # 8-bit files with alpha hold colour times alpha (a WebGL back buffer does)
    fit_gain: bool = False  # one factor on the reference's light, fitted per pair
    band: int = 4  # px on either side of a silhouette
    pixels_per_degree: float = 67.0  # FLIP: 0.7 m from a 0.7 m wide 4K screen
    hdr_exposures: tuple[float, float] = (-2.0, 2.0)  # HDR FLIP: stops around `exposure`; a picture every 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """The figures of one region. None: not defined for this pair."""

    region: RegionName
    pixels: int
    psnr: float  # dB of display values 0..1; infinite where equal
    ssim: float  # 1: equal
    flip: float  # mean LDR FLIP, 0: equal
    delta_e: float  # mean CIEDE2000
    delta_e_p99: float
    max_error: float  # largest difference of a display value
    rel_mse: float | None = None  # linear pairs: mean of d^2 / (ref^2 + 0.01 mean^2), mean: of ref where above 0
    hdr_flip: float | None = None  # linear pairs
    noise_psnr: float | None = None  # dB that noise and rounding alone would give
    noise_rel_mse: float | None = None  # relMSE that noise alone would give
    verdict: Verdict = "unknown"  # unknown: no noise is known


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """The result of one pair."""

    name: str
    reference: Path
    test: Path
    width: int
    height: int
    linear: bool  # both sides are linear light
    gain: float  # what the reference's light was multiplied by; 1 where none was fitted
    regions: tuple[Scores, ...]  # "all" first
    remark: str = ""  # what the test looks to have suffered, see `mirelight.compare.oversight`
    reference_settings: Mapping[str, Any] = field(default_factory=dict)
    test_settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def overall(self) -> Scores:
        """The scores over the whole picture (or its mask)."""
        return self.regions[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Maps:
    """The pictures behind a comparison's figures."""

    reference: F32  # (H, W, 3) display values
    test: F32  # (H, W, 3) display values
    flip: F32  # (H, W) 0..1
    signed: F32  # (H, W) luma of test minus luma of reference, display values
    counted: Bool  # (H, W) inside the mask
