"""What stands where on the page."""

from dataclasses import dataclass, fields
from importlib.resources import files
from typing import Any

import gradio as gr

from steered_marigold.app.inputs import SAMPLES, Disk
from steered_marigold.app.meshes import BACKGROUND
from steered_marigold.diffusion.settings import PRESETS
from steered_marigold.io.depth_encodings import DEPTH_ENCODINGS
from steered_marigold.io.depth_files import DEPTH_SUFFIXES
from steered_marigold.io.images import IMAGE_SUFFIXES

_STATIC = files("steered_marigold") / "app" / "static"
EMPTY = {
    "empty": "Choose a sample, or your own image and depth map; then press “Complete”. "
    "After that you can read the depth of every pixel, draw holes, and turn the scene in 3D."
}
DOWNLOADS = {
    "depth.png": "Depth, .png (16 bits, millimetres)",
    "depth.npy": "Depth, .npy (metres)",
    "depth.exr": "Depth, .exr (metres)",
    "uncertainty": "Uncertainty, .npy (metres)",
    "cloud": "Point cloud, .ply (metres)",
    "record": "Record, .json",
}
_PRESET_HELP = {
    "fast": "fast: one step, at once",
    "default": "default: ten steps twice, better",
    "paper": "paper: as published, 50 steps",
    "paper-minmax": "paper-minmax: as published, for uniform samples",
}
FIRST_PRESET = "fast"
MOST_UNCERTAIN = 1.0  # m of standard deviation that the scene shows at first


def static(name: str) -> str:
    """A file that is part of the page."""
    return (_STATIC / name).read_text("utf-8")


@dataclass(frozen=True, kw_only=True)
class ReadingFields:
    """How depth is read; the fields of `frames.sources.Reading` and an archive's array."""

    encoding: gr.Dropdown
    scale: gr.Number
    farthest: gr.Number
    baseline: gr.Number
    camera: gr.Textbox
    member: gr.Textbox
    registered: gr.Checkbox
    apply: gr.Button

    def all(self) -> list[Any]:
        """Those with a value, in the order in which handlers get them."""
        return [getattr(self, field.name) for field in fields(self) if field.name != "apply"]


@dataclass(frozen=True, kw_only=True)
class RunFields:
    """How to complete; the fields of `actions.Run`."""

    checkpoint: gr.Dropdown
    preset: gr.Dropdown
    strength: gr.Slider
    seed: gr.Number

    def all(self) -> list[Any]:
        """In the order in which handlers get their values."""
        return [getattr(self, field.name) for field in fields(self)]


@dataclass(frozen=True, kw_only=True)
class DiskFields:
    """Files on the server's disk; only where the page was started with a root."""

    images: gr.Dropdown
    depths: gr.Dropdown
    frame: gr.Dropdown
    refresh: gr.Button


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Every component that a handler reads or writes."""

    samples: dict[str, gr.Button]
    image: gr.File
    depth: gr.File
    disk: DiskFields | None
    source: gr.HTML
    reading: ReadingFields
    run: RunFields
    complete: gr.Button
    cancel: gr.Button
    status: gr.HTML
    message: gr.HTML
    facts: gr.HTML
    warnings: gr.HTML
    view: gr.HTML
    hole_tab: gr.Tab
    canvas: gr.HTML
    strokes: gr.Textbox
    erase: gr.Button
    restore: gr.Button
    scene_tab: gr.Tab
    scene: gr.Model3D
    scene_note: gr.HTML
    certainty: gr.Slider
    method_start: gr.Button
    method: gr.HTML
    tabs: gr.Tabs
    downloads_tab: gr.Tab
    downloads_note: gr.HTML
    downloads: dict[str, gr.DownloadButton]


def build_layout(checkpoints: list[str], disk: Disk | None) -> Layout:
    """Inside a `gr.Blocks`: choices on the left, what comes of them on the right."""
    gr.HTML(
        "<header><h1>SteeredMarigold</h1><p>Dense metric depth from an image and whatever depth a "
        "sensor measured, with an uncertainty for every pixel.</p></header>",
        elem_id="title",
    )
    with gr.Row(elem_id="columns"):
        with gr.Column(scale=1, min_width=320, elem_id="choices"):
            parts = _frame_choice(disk) | _reading() | _run(checkpoints)
        with gr.Column(scale=3, min_width=320, elem_id="answers"):
            parts["status"] = gr.HTML("", elem_id="status")
            parts["message"] = gr.HTML("", elem_id="message")
            with gr.Tabs(elem_id="views", overflow_behavior="wrap") as parts["tabs"]:
                parts |= _pictures() | _hole() | _scene() | _method() | _downloads()
    return Layout(**parts)


def _drawn(script: str, kind: str, value: Any = None, **how: Any) -> gr.HTML:
    """A component that its script draws from its value."""
    return gr.HTML(
        value or {},
        html_template=f'<div class="{kind}"></div>',
        js_on_load=static(script),
        apply_default_css=False,
        **how,
    )


def _frame_choice(disk: Disk | None) -> dict[str, Any]:
    parts: dict[str, Any] = {"disk": None}
    gr.HTML("<h2>1 · Frame</h2>")
    with gr.Tabs(overflow_behavior="wrap"):
        with gr.Tab("Samples"), gr.Row(elem_id="samples"):
            parts["samples"] = {
                name: gr.Button(name, icon=str(folder / "image.jpg"), min_width=80)
                for name, folder in SAMPLES.items()
            }
        with gr.Tab("Your files"):
            parts["image"] = gr.File(
                label="Image", file_types=list(IMAGE_SUFFIXES), height=130, elem_id="image-file"
            )
            parts["depth"] = gr.File(
                label="Depth map (with its metadata, if any)",
                file_types=[*DEPTH_SUFFIXES, ".txt", ".json"],
                file_count="multiple",
                height=130,
                elem_id="depth-file",
            )
        if disk is not None:
            with gr.Tab("On the server"):
                parts["disk"] = DiskFields(
                    images=gr.Dropdown(disk.images(), value=None, label="Images, or a recording"),
                    depths=gr.Dropdown(disk.depths(), value=None, label="Depth maps"),
                    frame=gr.Dropdown([], value=None, label="Frame", elem_id="disk-frame"),
                    refresh=gr.Button("Look for new files", size="sm"),
                )
    return parts


def _reading() -> dict[str, Any]:
    source = gr.HTML("", elem_id="source")
    with gr.Accordion("How depth is read", open=False, elem_id="reading"):
        encoding = gr.Dropdown(
            list(DEPTH_ENCODINGS),
            value="z",
            label="Encoding",
            info="z is depth along the optical axis; kitti and tum have their own unit.",
        )
        with gr.Row():
            scale = _number("Depth scale", "metres per unit; empty: guessed")
            farthest = _number("Farthest depth", "metres; beyond counts as missing")
        camera = gr.Textbox(label="Camera", info="fx,fy,cx,cy in pixels", placeholder="not known")
        with gr.Row():
            baseline = _number("Baseline", "metres, of disparity")
            member = gr.Textbox(
                label="Array", info="in an .npz or .h5", placeholder="only one", min_width=140
            )
        registered = gr.Checkbox(label="Lower resolution, same view as the image")
        apply = gr.Button("Read again", size="sm", elem_id="read-again")
    fields = ReadingFields(
        encoding=encoding,
        scale=scale,
        farthest=farthest,
        baseline=baseline,
        camera=camera,
        member=member,
        registered=registered,
        apply=apply,
    )
    return {"source": source, "reading": fields}


def _number(label: str, info: str) -> gr.Number:
    return gr.Number(value=None, label=label, info=info, minimum=0, min_width=140)


def _run(checkpoints: list[str]) -> dict[str, Any]:
    gr.HTML("<h2>2 · Complete</h2>")
    preset = gr.Dropdown(
        [(_PRESET_HELP.get(name, name), name) for name in sorted(PRESETS, key=_preset_order)],
        value=FIRST_PRESET,
        label="Preset",
        info="paper steers every step; fast and default fit the result to the measurements.",
        elem_id="preset",
    )
    with gr.Row():
        strength = gr.Slider(
            0.0,
            1.0,
            value=PRESETS[FIRST_PRESET].steering.steering_strength,
            step=0.05,
            label="Steering strength",
            info="0: not steered",
            min_width=170,
        )
        seed = gr.Number(
            0, label="Seed", info="repeats a result", precision=0, minimum=0, min_width=110
        )
    checkpoint = gr.Dropdown(
        checkpoints, value=checkpoints[0], label="Checkpoint", visible=len(checkpoints) > 1
    )
    with gr.Row():
        complete = gr.Button("Complete", variant="primary", elem_id="complete", min_width=150)
        cancel = gr.Button("Cancel", interactive=False, elem_id="cancel", min_width=90)
    run = RunFields(checkpoint=checkpoint, preset=preset, strength=strength, seed=seed)
    return {"run": run, "complete": complete, "cancel": cancel}


def _preset_order(name: str) -> int:
    return list(_PRESET_HELP).index(name) if name in _PRESET_HELP else len(_PRESET_HELP)


def _pictures() -> dict[str, Any]:
    with gr.Tab("Pictures", id="pictures"):
        warnings = gr.HTML("", elem_id="warnings")
        facts = gr.HTML("", elem_id="facts")
        view = _drawn("viewer.js", "viewer", EMPTY, elem_id="view")
    return {"warnings": warnings, "facts": facts, "view": view}


def _hole() -> dict[str, Any]:
    with gr.Tab("Draw a hole", id="hole") as tab:
        gr.HTML(
            "<p class='lead'>Paint over measured (coloured) pixels. They are hidden from the "
            "completion, and its answer is compared with what had been measured there.</p>"
        )
        canvas = _drawn("canvas.js", "hole", elem_id="canvas")
        strokes = gr.Textbox("[]", visible="hidden", label="strokes")
        with gr.Row(elem_id="hole-buttons"):
            erase = gr.Button("Erase and complete", variant="primary", elem_id="erase")
            restore = gr.Button("Bring everything back", elem_id="restore")
    return {
        "hole_tab": tab,
        "canvas": canvas,
        "strokes": strokes,
        "erase": erase,
        "restore": restore,
    }


def _scene() -> dict[str, Any]:
    with gr.Tab("3D", id="scene") as tab:
        gr.HTML("<p class='lead'>Drag to turn, scroll to come nearer.</p>")
        note = gr.HTML("", elem_id="scene-note")
        scene = gr.Model3D(
            show_label=False,
            height=520,
            clear_color=_clear_colour(),
            interactive=False,
            elem_id="scene",
        )
        certainty = gr.Slider(
            0.01,
            MOST_UNCERTAIN,
            value=MOST_UNCERTAIN,
            step=0.01,
            label="Leave out uncertain points",
            info="beyond so many metres of standard deviation; from half of it on they fade",
            elem_id="certainty",
        )
    return {"scene_tab": tab, "scene": scene, "certainty": certainty, "scene_note": note}


def _clear_colour() -> tuple[float, float, float, float]:
    red, green, blue = (c / 255 for c in BACKGROUND)
    return red, green, blue, 1.0


def _method() -> dict[str, Any]:
    with gr.Tab("The method", id="method"):
        gr.HTML(
            "<p class='lead'>The paper steers every denoising step towards the measurements. This "
            "runs its preset on the frame, once steered and once not, and shows each step. That is "
            "a hundred steps: half a minute or more on a laptop.</p>"
        )
        start = gr.Button("Run step by step", elem_id="method-start")
        method = _drawn("method.js", "method", elem_id="method-view")
    return {"method_start": start, "method": method}


def _downloads() -> dict[str, Any]:
    with gr.Tab("Downloads", id="downloads") as tab:
        gr.HTML("<p class='lead'>In depth files 0 means unknown; depth is z, in metres.</p>")
        note = gr.HTML("", elem_id="downloads-note")
        with gr.Column(elem_id="downloads"):
            buttons = {
                kind: gr.DownloadButton(
                    label, interactive=False, elem_id=f"get-{kind.replace('.', '-')}"
                )
                for kind, label in DOWNLOADS.items()
            }
    return {"downloads_tab": tab, "downloads_note": note, "downloads": buttons}
