"""3D Gaussian scenes with shared templates for repeated objects: load, render, edit, train; on Vulkan, without CUDA."""

from os import PathLike
from pathlib import Path
from typing import Any, Callable, Literal, Mapping, Optional, Sequence, TypedDict, Union, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

BACKGROUND: int
"""In Picture.instance_ids: the background is at the pixel's surface."""
NOTHING: int
"""In Picture.instance_ids: at least half of the light passes the pixel."""

_Path = Union[str, PathLike[str]]
_Device = Union[int, str]
_Split = Literal["test", "train", "all"]
_Which = Union[int, Sequence[int], str]
_Setting = Union[bool, int, float, str, PathLike[str], np.generic]

class Error(Exception):
    """What was asked for is not possible. The text is one line: what is wrong, where, and what to do."""

@final
class Gaussians:
    """N Gaussians in one frame, as 3DGS files store them. Every attribute is a new array."""

    def __init__(
        self, means: ArrayLike, quats: ArrayLike, log_scales: ArrayLike, opacity_logits: ArrayLike, sh: ArrayLike
    ) -> None:
        """Array-likes [N, 3], [N, 4], [N, 3], [N], [N, C, 3]; C is 1, 4, 9 or 16. Raises Error."""
    @property
    def means(self) -> NDArray[np.float32]:
        """Centres, [N, 3], scene units."""
    @property
    def quats(self) -> NDArray[np.float32]:
        """Rotations as quaternions (w, x, y, z) of any length but zero, [N, 4]."""
    @property
    def log_scales(self) -> NDArray[np.float32]:
        """Natural logarithms of the standard deviations, [N, 3], scene units."""
    @property
    def opacity_logits(self) -> NDArray[np.float32]:
        """Opacities before the sigmoid, [N]."""
    @property
    def sh(self) -> NDArray[np.float32]:
        """SH coefficients, [N, (sh_degree + 1)^2, 3]. Base colour = 0.2821 sh[:, 0] + 0.5."""
    @property
    def sh_degree(self) -> int:
        """The SH degree, 0 to 3."""
    def __len__(self) -> int: ...

@final
class Instance:
    """One placed copy of a template, as it was when the scene was asked."""

    @property
    def index(self) -> int:
        """Its index in the scene, which edits take."""
    @property
    def template(self) -> int:
        """Index of its template."""
    @property
    def id(self) -> Optional[int]:
        """Its mask id."""
    @property
    def group(self) -> Optional[str]:
        """Name of its group."""
    @property
    def gaussians(self) -> int:
        """Number of Gaussians that it shows: its template's and its own."""
    @property
    def own(self) -> int:
        """Number of Gaussians that it has beside its template's."""
    @property
    def first_offset(self) -> Optional[int]:
        """Index of its first record in Scene.offsets; None without offsets."""
    @property
    def scale(self) -> float:
        """Uniform scale from the template to the world."""
    @property
    def world_from_template(self) -> NDArray[np.float32]:
        """The similarity from the template's frame to the world, rows of (A | t), [3, 4]."""
    @property
    def centre(self) -> NDArray[np.float64]:
        """The mean of its template's means, in the world, [3]."""

@final
class Group:
    """A kind of object: its template, its name, and the mask ids of its instances."""

    @property
    def template(self) -> int: ...
    @property
    def name(self) -> Optional[str]: ...
    @property
    def instance_ids(self) -> list[int]: ...

class Outcome(TypedDict):
    """What an edit did, by indices of instances: those of removed ones before it, the others after it."""

    changed: list[int]
    added: list[int]
    removed: list[int]
    warnings: list[str]

class Offsets(TypedDict):
    """The differences of instances from their templates, one record for each of a template's Gaussians."""

    means: NDArray[np.float32]
    sh_dc: NDArray[np.float32]
    opacity_logits: NDArray[np.float32]

@final
class Scene:
    """A scene: templates, instances of them with offsets, and a background. A plain cloud has only a background."""

    def __init__(
        self,
        background: Optional[Gaussians] = None,
        *,
        templates: Sequence[Gaussians] = ...,
        instances: Sequence[tuple[int, ArrayLike]] = ...,
        names: Sequence[Optional[str]] = ...,
    ) -> None:
        """Gaussians in the world, those of each template in its frame, pairs (template, world_from_template) with a 3x4
        similarity, and the name of each template's kind of object. Raises Error."""
    @staticmethod
    def load(path: _Path) -> Scene:
        """Reads a scene: .instgs, .ply, .spz, .sog, .splat or .glb. Remarks on the file are warnings. Raises Error."""
    def save(
        self,
        path: _Path,
        pack: Optional[Literal["f32", "f16", "q8", "small"]] = None,
        *,
        data: Optional[_Path] = None,
        picture_psnr: Optional[float] = None,
        finish: int = 0,
        run: Optional[_Path] = None,
        up: Optional[ArrayLike] = None,
        device: Optional[_Device] = None,
    ) -> None:
        """Writes the scene: .instgs, .glb, .usda, .usdc and .html (a page that draws it) keep instances; .ply, .spz and .sog have
        them expanded.

        pack is for .instgs and .html; with data, a data set's folder, "small" is only as precise as its views need for pictures of
        picture_psnr dB. finish: number of steps, some 400, in which the written scene is trained through its rounding with the
        photos of data; this one does not change. run: the folder of the scene's run, which says their width, masks, background
        and exposures; without it they are taken at full size, on black. Ctrl-C is looked for after each view and step, and
        before the file is written. up: the direction that becomes +y of .glb, .usda and .usdc, and points up in .html. device:
        for data. Both are warned of where they are not used. Raises Error."""
    def copy(self) -> Scene:
        """An independent copy."""
    @overload
    def edit(
        self,
        operation: Literal["duplicate"],
        which: _Which,
        *,
        by: Optional[ArrayLike] = None,
        yaw: Optional[float] = None,
        up: Optional[ArrayLike] = None,
    ) -> Outcome:
        """Appends a copy of each instance, moved by a vector and rotated by yaw degrees about up."""
    @overload
    def edit(
        self,
        operation: Literal["move"],
        which: _Which,
        *,
        by: Optional[ArrayLike] = None,
        to: Optional[ArrayLike] = None,
    ) -> Outcome:
        """Moves instances by a vector, or the centre of one to a position."""
    @overload
    def edit(
        self,
        operation: Literal["rotate"],
        which: _Which,
        *,
        yaw: Optional[float] = None,
        axis: Optional[ArrayLike] = None,
        angle: Optional[float] = None,
        up: Optional[ArrayLike] = None,
    ) -> Outcome:
        """Rotates instances about their centres: by yaw degrees about up, or by angle degrees about axis."""
    @overload
    def edit(self, operation: Literal["scale"], which: _Which, *, by: float) -> Outcome:
        """Scales instances about their centres."""
    @overload
    def edit(self, operation: Literal["delete"], which: _Which) -> Outcome:
        """Removes instances."""
    @overload
    def edit(self, operation: Literal["recolour", "recolor"], which: _Which, *, rgb: ArrayLike) -> Outcome:
        """Shifts the base colour (1 = from black to white); a whole group changes in its template."""
    @overload
    def edit(self, operation: Literal["swap"], which: _Which, *, template: int) -> Outcome:
        """Gives instances another template; their offsets and own Gaussians are dropped."""
    @overload
    def edit(
        self,
        operation: Literal["scatter"],
        *,
        template: int,
        count: int,
        point: Optional[ArrayLike] = None,
        extent: Optional[ArrayLike] = None,
        normal: Optional[ArrayLike] = None,
        distance: Optional[float] = None,
        turn: Optional[float] = None,
        seed: Optional[int] = None,
        path: Optional[ArrayLike] = None,
        yaw: Optional[float] = None,
        area: Optional[ArrayLike] = None,
        offsets_of: Optional[_Which] = None,
        copy: bool = False,
        up: Optional[ArrayLike] = None,
    ) -> Outcome:
        """Adds at most 1000000 instances: over a plane (point, extent, normal) or in a polygon (area [N, 3]), at least distance
        apart and turned by up to turn degrees, or along a path [N, 3]; offsets_of gives them the offsets of an instance, shared,
        or copied with copy=True."""
    @overload
    def edit(
        self,
        operation: Literal["crop"],
        *,
        template: int,
        box: ArrayLike,
        keep: Literal["inside", "outside"] = "inside",
    ) -> Outcome:
        """Keeps the Gaussians of a template that are inside, or outside, a box of its frame, [2, 3]; sides may be infinite."""
    @overload
    def edit(self, operation: Literal["erase"], *, template: int, at: ArrayLike, radius: float) -> Outcome:
        """Removes the Gaussians of a template within radius of points of its frame, [N, 3]."""
    def flatten(self) -> Gaussians:
        """Every instance's Gaussians in the world, then the background: a plain cloud that looks the same."""
    def orbit(self, count: int, size: tuple[int, int] = (1280, 720), up: Optional[ArrayLike] = None) -> list[Camera]:
        """count cameras on a circle around the scene. Raises Error."""
    def own(self, k: int) -> Gaussians:
        """The Gaussians that instance k has beside its template's, in the template's frame. Raises Error."""
    @property
    def instances(self) -> list[Instance]:
        """The instances, in their order."""
    @property
    def groups(self) -> list[Group]:
        """The groups of instances with their names and mask ids."""
    @property
    def templates(self) -> list[Gaussians]:
        """The Gaussians of each template, in its frame."""
    @property
    def background(self) -> Gaussians:
        """The Gaussians in the world that belong to no instance; may be set."""
    @background.setter
    def background(self, value: Gaussians) -> None: ...
    @property
    def offsets(self) -> Offsets:
        """The offset records; Instance.first_offset says where an instance's begin."""
    @property
    def counts(self) -> dict[str, int]:
        """The number of Gaussians of each part, and of all instances expanded."""
    @property
    def source(self) -> str:
        """Where the scene came from, free text."""
    def __len__(self) -> int:
        """Number of Gaussians after expanding all instances."""

@final
class Camera:
    """A pinhole camera in OpenCV's axes: x right, y down, z forward. Pixel (i, j) has its centre at (i + 0.5, j + 0.5)."""

    def __init__(
        self,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        view_from_world: ArrayLike,
        name: str = "",
    ) -> None:
        """Sizes in pixels, and the rigid 4x4 matrix from world to view. Raises Error."""
    @staticmethod
    def look_at(
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        *,
        fov: float = 50.0,
        size: tuple[int, int] = (1280, 720),
        name: str = "",
    ) -> Camera:
        """A camera at eye that looks at target; fov is the vertical field of view in degrees. Raises Error."""
    @staticmethod
    def load(path: _Path) -> list[Camera]:
        """The cameras of a camera file, or of the cameras.json that INRIA's 3DGS leaves. Raises Error."""
    @staticmethod
    def of_data(data: _Path, split: _Split = "test") -> list[Camera]:
        """The cameras of a data set's views. Raises Error."""
    def resized(self, width: int, height: int) -> Camera:
        """The same view with a picture of width x height pixels."""
    @property
    def view_from_world(self) -> NDArray[np.float64]:
        """The transform from world to view, [4, 4]."""
    @property
    def position(self) -> NDArray[np.float64]:
        """Centre of the camera in the world, [3]."""
    @property
    def name(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...

@final
class Picture:
    """A picture of H rows and W columns, from the top left."""

    @property
    def colour(self) -> NDArray[np.float32]:
        """Colour over the background, [H, W, 3], in the encoding of the photos (sRGB); may exceed 0..1."""
    @property
    def alpha(self) -> NDArray[np.float32]:
        """1 - transmittance, [H, W]."""
    @property
    def depth(self) -> NDArray[np.float32]:
        """Expected view depth, [H, W], scene units; 0 where nothing was drawn."""
    @property
    def instance_ids(self) -> Optional[NDArray[np.int32]]:
        """Index of the instance at the surface, [H, W]; BACKGROUND or NOTHING where there is none. None with ids=False."""
    @property
    def visible(self) -> int:
        """Number of Gaussians that touch the picture."""
    def rgb8(self) -> NDArray[np.uint8]:
        """The colours as 8-bit rgb, [H, W, 3]."""
    def save(self, path: _Path) -> None:
        """Writes a PNG file of 8 bits per channel. Raises Error."""

@final
class Renderer:
    """Draws scenes on one Vulkan device. The last scene stays there until another one, or a changed one, is drawn."""

    def __init__(self, device: Optional[_Device] = None) -> None:
        """A device's number in devices() or a part of its name; by default that of the environment variable INSTGS_DEVICE,
        else the fastest kind. Raises Error."""
    def render(
        self,
        scene: Scene,
        camera: Camera,
        *,
        background: Optional[Sequence[float]] = None,
        near: Optional[float] = None,
        antialias: Optional[bool] = None,
        dilation: Optional[float] = None,
        lod: Optional[float] = None,
        hide: Optional[_Which] = None,
        ids: bool = True,
    ) -> Picture:
        """Draws the scene as the camera sees it. background: rgb behind everything; near: depth of the near plane, and antialias,
        dilation (px^2), the pixel filter: by default the scene's; lod: merge far Gaussians with an error of at most that many
        pixels; hide: instances to leave out, [] for none; ids: whether instance_ids are made. Raises Error."""
    @property
    def device(self) -> str:
        """Name of the device."""

class _AlwaysMeasured(TypedDict):
    psnr: float
    ssim: float
    lpips: Optional[float]

class _Figures(_AlwaysMeasured, total=False):
    psnr_exposed: float

class _ViewFigures(_Figures):
    name: str

class Evaluation(TypedDict):
    """The figures of each view and their means: PSNR in dB, SSIM, and LPIPS if its weights were there; with exposures, also PSNR
    up to the photos' exposures."""

    views: list[_ViewFigures]
    mean: _Figures

@final
class Trained:
    """What a finished run made."""

    @property
    def scene(self) -> Scene:
        """The trained scene, as in RUN/scene.instgs."""
    @property
    def report(self) -> dict[str, Any]:
        """The contents of RUN/report.json: steps, seconds, figures of the test views, counts, sizes, device."""
    @property
    def folder(self) -> Path:
        """The run folder, with report.html and all else."""

def train(
    data: _Path,
    out: _Path,
    method: Optional[Literal["3dgs", "instgs"]] = None,
    *,
    config: Optional[_Path] = None,
    set: Optional[Mapping[str, _Setting]] = None,
    resume: bool = False,
    accept_changed_data: bool = False,
    device: Optional[_Device] = None,
    on_event: Optional[Callable[[dict[str, Any]], object]] = None,
) -> Trained:
    """Trains a scene from a data set's photos into the run folder out, as the command line's train.

    method: by default the configuration's. config: a preset ("quick", "instgs_quick", ...) or a TOML file. set: values above
    the configuration's, {"steps": 500, "joint.steps": 300}; a path object becomes absolute. resume: continue the run of train in
    out with its configuration (one of a Pipeline goes on with Pipeline(..., resume=True).joint); where there is none, a new one
    begins with a warning. accept_changed_data: continue although the data set has changed since. on_event: called with a dict for
    every event, as in events.jsonl, with the "phase".

    Ctrl-C, and an exception of on_event, stop the run after the step, with a checkpoint, or after the photo that is being read;
    then that exception is raised. Raises Error."""

@final
class Segments:
    """A plain cloud of N Gaussians and the object of each, from Pipeline.segment."""

    @property
    def cloud(self) -> Scene:
        """The plain cloud."""
    @property
    def labels(self) -> NDArray[np.uint32]:
        """The object of each Gaussian, 0 for none, [N]."""
    @property
    def weights(self) -> NDArray[np.float32]:
        """What each Gaussian contributes to all training views, pixels, [N]."""
    @property
    def views_seen(self) -> NDArray[np.uint32]:
        """The number of training views to which each Gaussian contributes, [N]."""
    @property
    def objects(self) -> list[dict[str, Any]]:
        """The objects that the masks show: "id", "category", "views", "masks", "gaussians"."""
    @property
    def cameras(self) -> list[Camera]:
        """The training views' cameras, at the size that is trained at."""
    def relabelled(self, labels: ArrayLike) -> Segments:
        """The same with other labels, [N], whole numbers from 0 to 65535: what you know better than the masks. The files of the
        folder keep those found. Raises Error."""
    def __len__(self) -> int: ...

class _GroupNeeds(TypedDict):
    ids: ArrayLike
    world_from_template: ArrayLike

class GivenGroup(_GroupNeeds, total=False):
    """A group of your own: ids of objects [K], the reference first, and where they stand [K, 3, 4]."""

    template_id: int
    name: Optional[str]
    score: Optional[float]

class PoseGroup(TypedDict):
    """A group of objects that are alike: ids [K], the reference first, and where they stand [K, 3, 4]."""

    template_id: int
    name: Optional[str]
    score: Optional[float]
    ids: NDArray[np.uint32]
    world_from_template: NDArray[np.float32]

@final
class Poses:
    """Groups of objects that are alike and the pose of each, from Pipeline.register or your own."""

    def __init__(self, groups: Sequence[Union[GivenGroup, PoseGroup]]) -> None:
        """Groups of your own; they are shared even if the objects are not much alike. Raises Error."""
    @property
    def groups(self) -> list[PoseGroup]:
        """The groups, with new arrays."""
    @property
    def objects(self) -> list[dict[str, Any]]:
        """How each object was registered: "instance", "group", "verdict", "inliers", "rmse", "note", ...; empty for given
        groups."""
    def __len__(self) -> int:
        """Number of groups."""

@final
class Merged:
    """The scene that the joint phase starts from, and how alike its objects were."""

    @property
    def scene(self) -> Scene:
        """Templates, instances and background; only background if nothing is shared."""
    @property
    def groups(self) -> list[dict[str, Any]]:
        """For each group its template, the match distance and what became of its objects."""
    @property
    def hardly_seen(self) -> int:
        """Number of Gaussians of the cloud that were left out because they hardly contribute to any view."""

@final
class Pipeline:
    """The stages from a plain cloud to a trained scene of templates and instances: segment, register, template, joint.

    Each stage takes what the one before returned, or what you made of it, and leaves its files in the folder, as the command
    line's stages do. Ctrl-C and an exception of on_event stop a stage."""

    def __init__(
        self,
        data: _Path,
        out: _Path,
        *,
        config: Optional[_Path] = None,
        set: Optional[Mapping[str, _Setting]] = None,
        resume: bool = False,
        accept_changed_data: bool = False,
        device: Optional[_Device] = None,
        on_event: Optional[Callable[[dict[str, Any]], object]] = None,
    ) -> None:
        """config, set and on_event are those of train. resume: the folder's configuration is used, segment reads labels that are
        there, and joint goes on from its last checkpoint, for which it wants the scene that it began with; where there is no run,
        a new one begins with a warning. accept_changed_data: joint goes on although the data set has changed since. Raises
        Error."""
    def segment(self, cloud: Scene) -> Segments:
        """Finds the object of each Gaussian of a trained plain cloud in the masks of its training views. Raises Error."""
    def register(self, segments: Segments) -> Poses:
        """Finds which objects are alike and the pose of each. With the configuration's "groups" it takes these, and refines their
        poses unless that is off. Raises Error."""
    def template(self, segments: Segments, poses: Poses) -> Merged:
        """Makes one template for each group, with offsets for its objects. The scene is not trained yet. Raises Error."""
    def joint(self, scene: Scene) -> Trained:
        """Trains templates, offsets, background and poses together, from Merged.scene or another instanced scene. One that was
        stopped goes on with Pipeline(..., resume=True).joint of the same scene. Raises Error."""
    @property
    def folder(self) -> Path:
        """The folder of the results."""

def eval(
    scene: Scene,
    data: _Path,
    *,
    split: _Split = "test",
    width: Optional[int] = None,
    background: Optional[Sequence[float]] = None,
    near: Optional[float] = None,
    antialias: Optional[bool] = None,
    dilation: Optional[float] = None,
    exposures: bool = False,
    lpips: Optional[Literal["alex", "vgg", "squeeze"]] = None,
    lpips_weights: Optional[_Path] = None,
    lpips_range: Literal["11", "01"] = "11",
    skip_missing: bool = False,
    device: Optional[_Device] = None,
    on_view: Optional[Callable[[str, _Figures], object]] = None,
) -> Evaluation:
    """Renders a data set's views and compares them with the photos.

    width: the photos are downscaled to it. exposures: also PSNR up to the photos' exposures. lpips: "alex" if none is named; one
    that is named and has no weights is left out with a warning. lpips_range: range of the network's input, "11" = -1..1, as it was
    trained, or "01" = 0..1: lpips="vgg", lpips_range="01" is what the 3DGS paper's metrics.py computes. Raises Error, or what
    on_view raises."""

def synth(
    out: _Path,
    name: str = "cars",
    *,
    views: int = 48,
    size: tuple[int, int] = (320, 180),
    seed: int = 1,
    instances: Optional[int] = None,
) -> None:
    """Renders photos of a procedural scene with repeated objects, with masks, depths, poses, cameras and points. Raises
    Error."""

def devices() -> list[dict[str, Any]]:
    """The Vulkan devices of this machine, in the order of their numbers: name, driver and limits. Raises Error."""
