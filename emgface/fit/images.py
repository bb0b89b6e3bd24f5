"""Images of a head prepared and segmented by SimpleITK and scikit-image; clicks come from a file.

Bias by N4; stacks of three planes brought to one frame by fiducials and averaged; rigid registration of
two images by mutual information (Mattes); contours of a slice by the cheapest path between clicks, and
regions of a volume by the morphological Chan-Vese method, from clicks inside. Images are those of
SimpleITK, points are in LPS and metres; nothing here replaces a segmentation program.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FitError
from emgface.fit.readers.volumes import toolkit
from emgface.fit.similarity import Similarity, misfit, similarity

LEAST_FIDUCIALS: Final = 3  #: smallest number of common fiducials
MISFIT: Final = 2e-3  #: largest rms distance of fiducials after a rigid motion [m]
#: smallest share of an image inside the other after registration [1]
LEAST_IMAGE_OVERLAP: Final = 0.3
LARGEST_REGISTRATION_MOTION: Final = 60e-3  #: largest motion by a registration [m]
REGION_SURROUNDINGS: Final = 8e-3  #: width of the surroundings of a region [m]
#: distance from the border of a region within which voxels contain both sides [m]
REGION_EDGE: Final = 1.5e-3
LARGEST_REGION_SHARE: Final = 0.6  #: largest share of the image that is a region [1]
VOXELS: Final = 4.0  #: in the radius of a ball around a click [1]
AIR: Final = 0.0  #: value outside an image


@dataclass(frozen=True, eq=False)
class Registered:
    """Rigid motion of points of the moving image onto the fixed one, and the measure at its end."""

    motion: Similarity
    mutual_information: float  #: negative, in nats
    overlap: float  #: share of the fixed image inside the moving one [1]


def without_bias(image: Any, *, shrink: int = 4) -> Any:
    """Image divided by its bias field (N4), which is estimated on a coarser one; values are positive."""
    sitk = toolkit()
    image = sitk.Cast(image, sitk.sitkFloat32)
    values = sitk.GetArrayViewFromImage(image)
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() > 0.0):
        raise FitError(
            "the image has negative or no values, expected intensities of a magnitude image"
        )
    mask = sitk.OtsuThreshold(image, 0, 1, 200)
    size = [min(shrink, max(1, n // 8)) for n in image.GetSize()]
    method = sitk.N4BiasFieldCorrectionImageFilter()
    method.SetMaximumNumberOfIterations([50, 50, 30])
    method.Execute(sitk.Shrink(image, size), sitk.Shrink(mask, size))
    return image / sitk.Cast(sitk.Exp(method.GetLogBiasFieldAsImage(image)), sitk.sitkFloat32)


def combined_stacks(
    images: Sequence[Any], fiducials: Sequence[Mapping[str, Sequence[float]]], spacing: float
) -> tuple[Any, list[Similarity]]:
    """One image of stacks with different planes, in the frame of the first, with this spacing [m].

    `fiducials` are points [m] by name in the frame of each stack; a rigid motion brings those of a
    stack onto those of the first. Voxels are the mean of the stacks that contain them, by linear
    interpolation. Returns the image and the motions. Raises FitError if fewer than three fiducials are
    common, they lie on a line, or their distances differ.
    """
    if len(images) != len(fiducials) or not images:
        raise FitError(
            f"{len(images)} stacks have fiducials of {len(fiducials)}, expected one set for each"
        )
    motions = [_by_fiducials(given, fiducials[0], k) for k, given in enumerate(fiducials)]
    sitk = toolkit()
    frame = _grid_of(images[0], spacing)
    total, weight = 0.0, 0.0
    for image, motion in zip(images, motions, strict=True):
        back = _transform(_inverse(motion))
        values = sitk.Cast(image, sitk.sitkFloat32)
        one = values * 0.0 + 1.0
        total = total + sitk.Resample(values, frame, back, sitk.sitkLinear, AIR)
        weight = weight + sitk.Resample(one, frame, back, sitk.sitkLinear, AIR)
    return total / sitk.Maximum(weight, 1e-6), motions


def registered_images(fixed: Any, moving: Any, start: Similarity | None = None) -> Registered:
    """Rigid registration by mutual information, from coarse to fine; samples are the same in every run.

    `start` is the motion at the beginning, such as that of fiducials, because the method needs overlap.
    Raises FitError if it fails, ends far away, or the images hardly overlap.
    """
    sitk = toolkit()
    fixed, moving = (sitk.Cast(image, sitk.sitkFloat32) for image in (fixed, moving))
    begin = start or Similarity(1.0, np.eye(3), np.zeros(3))
    first = sitk.Euler3DTransform(_transform(_inverse(begin)))
    first.SetCenter(fixed.TransformContinuousIndexToPhysicalPoint([n / 2 for n in fixed.GetSize()]))
    _keep(first, _inverse(begin))
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMattesMutualInformation(40)
    method.SetMetricSamplingStrategy(method.REGULAR)
    method.SetMetricSamplingPercentage(0.2, 1)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 200, relaxationFactor=0.7)
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel([4, 2, 1])
    method.SetSmoothingSigmasPerLevel([2.0, 1.0, 0.0])
    method.SetInitialTransform(first, inPlace=False)
    try:
        transform = sitk.Euler3DTransform(
            sitk.CompositeTransform(method.Execute(fixed, moving)).GetNthTransform(0)
        )
    except RuntimeError as error:
        raise FitError(
            "the images could not be registered (they hardly overlap), expected a start by fiducials"
        ) from error
    motion = _inverse(_motion(transform))
    one = moving * 0.0 + 1.0
    inside = sitk.Resample(one, fixed, transform, sitk.sitkNearestNeighbor, 0.0)
    overlap = float(sitk.GetArrayViewFromImage(inside).mean())
    middle = 1e-3 * np.array(
        moving.TransformContinuousIndexToPhysicalPoint([n / 2 for n in moving.GetSize()])
    )
    went = float(np.linalg.norm(motion(middle[None]) - begin(middle[None])))
    if overlap < LEAST_IMAGE_OVERLAP or went > LARGEST_REGISTRATION_MOTION:
        raise FitError(
            f"the registration ended {1e3 * went:.3g} mm from its start with an overlap of "
            f"{overlap:.0%}, expected at most {1e3 * LARGEST_REGISTRATION_MOTION:.0f} mm and at "
            f"least {LEAST_IMAGE_OVERLAP:.0%}: start from fiducials"
        )
    return Registered(motion, float(method.GetMetricValue()), overlap)


def contour_through(values: NDArray[Any], clicks: NDArray[Any]) -> NDArray[np.int64]:
    """Closed contour (n, 2) of pixels through clicks (k, 2) of a slice, along its edges.

    The cheapest path between consecutive clicks; the cost of a pixel is 1 / (1 + g / median g), with
    the magnitude g of the gradient (Mortensen and Barrett 1995).
    """
    from scipy.ndimage import gaussian_gradient_magnitude
    from skimage.graph import route_through_array

    clicks = _in_slice(values, clicks)
    g = gaussian_gradient_magnitude(np.asarray(values, dtype=np.float64), 1.0)
    cost = 1.0 / (1.0 + g / max(float(np.quantile(g, 0.9)), 1e-12)) ** 2
    contour: list[Any] = []
    for a, b in zip(clicks, np.roll(clicks, -1, axis=0), strict=True):
        path, _ = route_through_array(cost, a.tolist(), b.tolist(), geometric=True)
        contour.extend(path[:-1])
    return np.array(contour, dtype=np.int64)


def region_around(
    image: Any, clicks: Sequence[Sequence[float]], *, radius: float = 4e-3, iterations: int = 60
) -> NDArray[np.bool_]:
    """Mask (k, j, i) of the region around clicks [m] whose mean differs from its surroundings.

    Morphological Chan-Vese (Marquez-Neila et al. 2014) from balls of this radius, first in the image,
    then in a box around the region, whose surroundings alone then count, in cubic voxels of a quarter
    of the radius; the connected part with a click is kept. Its border is then found in the voxels of the
    image (`_with_own_border`). Raises FitError for a click outside the image, or if the region fills it.
    """
    from skimage.measure import label

    sitk = toolkit()
    at = np.array(
        [image.TransformPhysicalPointToContinuousIndex([1e3 * x for x in p]) for p in clicks]
    )
    size = np.array(image.GetSize())
    if not len(at) or ((at < 0) | (at > size - 1)).any():
        raise FitError(
            f"a click of {len(at)} lies outside the image, expected clicks in the region: check the "
            "frame (LPS or RAS) and the unit"
        )
    if not np.isfinite(sitk.GetArrayViewFromImage(image)).all():
        raise FitError(
            "the image has values that are not finite, expected a number in every voxel: replace them"
        )
    fine = radius / VOXELS  # with fewer voxels in a ball, smoothing removes it
    own_grid = _grid_of(image, fine)
    cubes = sitk.Resample(sitk.Cast(image, sitk.sitkFloat32), own_grid)
    values = sitk.GetArrayFromImage(cubes)
    start = np.zeros(values.shape, dtype=np.uint8)
    seeds = at * (1e-3 * np.array(image.GetSpacing()) / fine)  # in voxels of the cubes
    for point in seeds:
        k, j, i = np.ogrid[tuple(slice(0, n) for n in values.shape)]
        away = (i - point[0]) ** 2 + (j - point[1]) ** 2 + (k - point[2]) ** 2
        start |= (away < VOXELS**2).astype(np.uint8)
    region = _grown(values, start > 0, iterations)
    for _ in range(2):  # again with the mean of the surroundings alone, which others do not change
        box = _box_around(region, int(np.ceil(REGION_SURROUNDINGS / fine)))
        region[box] = _grown(values[box], region[box], iterations)
    parts: Any = label(region, connectivity=1)
    last = np.array(values.shape) - 1
    chosen = {int(parts[tuple(np.minimum(np.rint(p).astype(int)[::-1], last))]) for p in seeds} - {
        0
    }
    kept = sitk.GetImageFromArray(np.isin(parts, list(chosen)).astype(np.uint8))
    kept.CopyInformation(cubes)
    like = sitk.Resample(kept, image, sitk.Transform(), sitk.sitkNearestNeighbor)
    mask = _with_own_border(
        sitk.GetArrayFromImage(image),
        sitk.GetArrayFromImage(like) > 0,
        1e-3 * np.array(image.GetSpacing())[::-1],
    )
    if not mask.any():
        raise FitError(
            "no region remains around the clicks, expected one whose intensity differs from its "
            "surroundings: click inside it, away from its border"
        )
    if mask.mean() > LARGEST_REGION_SHARE:
        raise FitError(
            f"the region around the clicks fills {mask.mean():.0%} of the image, expected at most "
            f"{LARGEST_REGION_SHARE:.0%}: add clicks, or crop the image"
        )
    return mask


def _grown(values: NDArray[Any], start: NDArray[np.bool_], iterations: int) -> NDArray[np.bool_]:
    """Region after at most these iterations, fewer if ten do not change it."""
    from skimage.segmentation import morphological_chan_vese

    method: Any = morphological_chan_vese
    for _ in range(-(-iterations // 10)):
        grown = method(values, 10, init_level_set=start, smoothing=1) > 0
        if np.array_equal(grown, start):
            break
        start = grown
    return start


def _with_own_border(
    values: NDArray[Any], mask: NDArray[np.bool_], spacing: NDArray[Any]
) -> NDArray[np.bool_]:
    """Region whose border is where values are midway between its median and that of its surroundings.

    This is the criterion of Chan and Vese without their term of length, which makes small parts smaller.
    Voxels near the border, which contain both sides, count for neither median, and they alone change; of
    these the majority among neighbours decides, and parts without a core are left out. `spacing` is that
    of the axes of the values [m].
    """
    from scipy.ndimage import distance_transform_edt, uniform_filter
    from skimage.measure import label

    if not mask.any():
        return mask
    box = _box_around(mask, int(np.ceil(REGION_SURROUNDINGS / spacing.min())))
    own, v = mask[box], values[box]
    inside: Any = distance_transform_edt(own, sampling=spacing)
    outside: Any = distance_transform_edt(~own, sampling=spacing)
    core = inside > min(REGION_EDGE, 0.8 * float(inside.max()))
    around = (outside > REGION_EDGE) & (outside < REGION_SURROUNDINGS)
    if not around.any():
        return mask
    middle, beyond = float(np.median(v[core])), float(np.median(v[around]))
    nearer = np.abs(v - middle) < np.abs(v - beyond)
    new = np.where(np.maximum(inside, outside) < REGION_EDGE + spacing.max(), nearer, own)
    parts: Any = label(uniform_filter(new.astype(np.float64), 3) > 0.5, connectivity=1)
    bordered = mask.copy()
    bordered[box] = (parts > 0) & np.isin(parts, np.unique(parts[core]))
    return bordered


def _box_around(mask: NDArray[np.bool_], more: int) -> tuple[slice, ...]:
    """Slices of the smallest box that contains a mask, with a margin of voxels."""
    slices: list[slice] = []
    for axis in range(mask.ndim):
        at = np.flatnonzero(mask.any(axis=tuple(k for k in range(mask.ndim) if k != axis)))
        low, high = (at[0], at[-1] + 1) if len(at) else (0, mask.shape[axis])
        slices.append(slice(max(0, int(low) - more), int(high) + more))
    return tuple(slices)


def _by_fiducials(
    given: Mapping[str, Sequence[float]], first: Mapping[str, Sequence[float]], number: int
) -> Similarity:
    names = [name for name in given if name in first]
    if len(names) < LEAST_FIDUCIALS:
        raise FitError(
            f"stack {number} has {len(names)} fiducials in common with the first, expected at "
            f"least {LEAST_FIDUCIALS}"
        )
    a, b = (np.array([s[name] for name in names], dtype=np.float64) for s in (given, first))
    extent = np.linalg.svd(b - b.mean(axis=0), compute_uv=False)
    if not extent[1] > 0.05 * extent[0]:
        raise FitError(f"the fiducials of stack {number} lie on a line, expected three that do not")
    motion = similarity(a, b, scaled=False)
    if not (off := misfit(motion, a, b)) <= MISFIT:
        mirror = misfit(similarity(a, b, scaled=False, mirrored=True), a, b)
        kind = "are mirrored, or differ" if mirror < 0.5 * off else "differ"
        raise FitError(
            f"the fiducials of stack {number} {kind} by {1e3 * off:.3g} mm rms after the best rotation, "
            f"expected at most {1e3 * MISFIT:.3g} mm: check their names, frame and unit"
        )
    return motion


def _grid_of(image: Any, spacing: float) -> Any:
    """Empty image over the same box with an equal spacing [m]."""
    sitk = toolkit()
    wanted = 1e3 * spacing
    size = [
        max(2, round((n - 1) * s / wanted) + 1)
        for n, s in zip(image.GetSize(), image.GetSpacing(), strict=True)
    ]
    grid = sitk.Image(size, sitk.sitkFloat32)
    grid.SetSpacing([wanted] * 3)
    grid.SetOrigin(image.GetOrigin())
    grid.SetDirection(image.GetDirection())
    return grid


def _inverse(motion: Similarity) -> Similarity:
    R = motion.rotation.T
    return Similarity(1.0, R, -R @ motion.shift)


def _transform(motion: Similarity) -> Any:
    transform = toolkit().Euler3DTransform()
    _keep(transform, motion)
    return transform


def _keep(transform: Any, motion: Similarity) -> None:
    """Set a transform with any centre c [mm] to a motion: y = R (x - c) + c + t."""
    c = np.array(transform.GetCenter())
    transform.SetMatrix([float(v) for v in motion.rotation.ravel()], 1e-6)
    t = 1e3 * motion.shift + motion.rotation @ c - c
    transform.SetTranslation([float(v) for v in t])


def _motion(transform: Any) -> Similarity:
    R = np.array(transform.GetMatrix()).reshape(3, 3)
    c, t = np.array(transform.GetCenter()), np.array(transform.GetTranslation())
    return Similarity(1.0, R, 1e-3 * (c + t - R @ c))


def _in_slice(values: NDArray[Any], clicks: NDArray[Any]) -> NDArray[np.int64]:
    index = np.rint(np.asarray(clicks, dtype=np.float64)).astype(np.int64)
    if values.ndim != 2 or index.ndim != 2 or index.shape[1] != 2 or len(index) < 3:
        raise FitError(
            f"the slice has {values.ndim} dimensions and the clicks the shape {index.shape}, expected a "
            "slice (rows, columns) and at least three clicks (k, 2)"
        )
    if (index < 0).any() or (index >= values.shape).any():
        raise FitError(
            f"a click lies outside the slice of {values.shape} pixels, expected all inside"
        )
    return index


__all__ = [
    "Registered", "combined_stacks", "contour_through", "region_around",
    "registered_images", "without_bias",
]  # fmt: skip
