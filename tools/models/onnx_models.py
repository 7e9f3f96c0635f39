"""What the export scripts share: the models folder, exporting a graph, and comparing it with PyTorch before it counts.

A models folder holds ONNX graphs and models.json, which names each file with its length and SHA-256. Each script
replaces its own part of models.json and leaves the others alone. Files come under their names only when complete.
"""

import contextlib
import hashlib
import importlib.util
import json
import os
import pathlib
import pickle
import shutil
import sys
import tempfile
import warnings

FORMAT = "instgs-models/1"
# The newest that PyTorch's tracing exporter writes; GridSample and Resize are complete in it.
OPSET = 20
# Largest difference between PyTorch and the exported graph that is accepted; see `differences` for its unit.
LIMIT = 1e-3
# A protobuf message holds at most 2 GiB, so a larger graph keeps its weights in a file beside it.
INLINE_LIMIT = 1_900_000_000
# What pip installs where the module is called otherwise.
PIP_NAMES = {"PIL": "pillow", "mobile_sam": "git+https://github.com/ChaoningZhang/MobileSAM.git"}


def fail(message: str) -> None:
    sys.exit(f"error: {message}")


def need(*modules: str) -> None:
    """Ends in one line with the pip command where a module is not installed."""
    missing = [m for m in modules if importlib.util.find_spec(m) is None]
    if missing:
        packages = " ".join(PIP_NAMES.get(m, m) for m in missing)
        fail(f"these Python packages are missing: {' '.join(missing)}  (python3 -m pip install {packages})")


need("torch", "torchvision", "transformers", "tokenizers", "onnx", "onnxruntime", "numpy")

import numpy as np  # noqa: E402
import onnx  # noqa: E402
import onnxruntime  # noqa: E402
import torch  # noqa: E402
import transformers  # noqa: E402

transformers.logging.set_verbosity_error()


def first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


@contextlib.contextmanager
def plain_errors(what: str):
    """Turns errors of files and of downloads into one line that says `what` could not be done."""
    try:
        yield
    except (OSError, ValueError, ImportError, KeyError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        fail(f"{what}: {first_line(error)}")


def load_model(kind, model: str):
    """The weights of `model`, a name on the Hugging Face hub or a folder of save_pretrained. `kind`: its class. Ends in
    words where they are of another kind of model or incomplete: transformers would fill up with random numbers."""
    wanted = kind.config_class.model_type
    found = load_part(transformers.AutoConfig, model).model_type
    if found != wanted:
        fail(f"{model} is a checkpoint of {found}, not of {wanted}")
    weights, facts = load_part(kind, model, output_loading_info=True)
    missing = sorted(facts["missing_keys"])
    if missing:
        fail(f"{model} lacks {len(missing)} tensors of {wanted}, the first is {missing[0]}")
    return weights


def load_part(kind, model: str, **options):
    if model.startswith(("/", ".", "~")) and not pathlib.Path(model).is_dir():
        fail(f"the folder {model} does not exist")
    hint = "a name needs network access to the Hugging Face hub the first time; a folder must be one of save_pretrained"
    with plain_errors(f"cannot load {model} ({hint})"):
        return kind.from_pretrained(model, **options)


def source_name(model: str) -> str:
    """What models.json says about where weights came from: never a path of this machine."""
    path = pathlib.Path(model)
    return path.resolve().name if path.exists() else model


def is_bilinear(processor) -> bool:
    """True if an image processor resizes bilinearly, as the Rust side does."""
    return getattr(processor.resample, "value", processor.resample) == 2


def export_part(name: str, origin: tuple, modules: list, files: dict, make, out: pathlib.Path) -> None:
    """Exports `modules` as one part of the models folder `out`.

    `origin`: what models.json says about the kind of the model and where its weights came from. `make` writes `files`
    (key in models.json -> name) into the folder that it gets, and returns what else models.json says about the part.
    """
    kind, source = origin
    open_folder(out, sum(parameter_bytes(module) for module in modules))
    with partial_folder(out) as folder:
        print(f"{name}: exporting {source}", flush=True)
        facts = make(folder)
        entries = {key: publish(folder, out, file) for key, file in files.items()}
    merge_manifest(out, name, {"kind": kind, "source": source, "opset": OPSET, **entries, **facts})


def open_folder(out: pathlib.Path, weights_bytes: int) -> None:
    """Makes the folder; ends in words where the disk is too small for the graph and the copy it is made from, or where
    the folder's models.json cannot be added to."""
    with plain_errors(f"cannot make the folder {out}"):
        out.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(out).free
    needed = 2 * weights_bytes + 100_000_000
    if free < needed:
        fail(f"{out} has {free / 1e9:.1f} GB of disk left, the export needs about {needed / 1e9:.1f} GB")
    read_manifest(out)


def parameter_bytes(module: torch.nn.Module) -> int:
    return sum(p.numel() * p.element_size() for p in module.parameters())


@contextlib.contextmanager
def partial_folder(out: pathlib.Path):
    """A folder inside `out`, on the same disk, that is gone afterwards."""
    with plain_errors(f"cannot write to {out}"):
        folder = pathlib.Path(tempfile.mkdtemp(prefix=".partial-", dir=out))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def trace_to_onnx(module, inputs: dict, outputs: dict, dynamic: dict, path: pathlib.Path):
    """Exports `module` with `inputs` (name -> example) and `outputs` (name -> shape, names for dynamic sizes).

    `dynamic`: input -> {axis: name}. Uses the tracing exporter: with height and width of Grounding DINO's picture free,
    the other one did not end within ten minutes of symbolic algebra. Returns the onnx model, stripped.
    """
    folder = path.parent / "traced"  # its own: weights beyond 2 GiB come as one file each
    folder.mkdir()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        with plain_errors(f"the export of {path.name} failed (are the versions those of tools/models/README.md?)"):
            torch.onnx.export(
                module,
                tuple(inputs.values()),
                str(folder / path.name),
                input_names=list(inputs),
                output_names=list(outputs),
                dynamic_axes=dynamic,
                opset_version=OPSET,
                dynamo=False,
            )
            model = onnx.load(folder / path.name)
    shutil.rmtree(folder)
    strip(model, outputs)
    return model


def strip(model, outputs: dict) -> None:
    """Takes out what no runtime reads: stack traces, notes, shapes between nodes, long names of nodes and values."""
    graph = model.graph
    del model.metadata_props[:]
    del graph.value_info[:]
    kept = {v.name for v in graph.input} | {v.name for v in graph.output} | {""}
    short = {}

    def rename(names) -> None:
        for i, name in enumerate(names):
            if name not in kept:
                names[i] = short.setdefault(name, f"v{len(short)}")

    share_constants(graph)
    rename_nodes(graph, rename)
    for value in graph.output:
        set_shape(value, outputs[value.name])


def share_constants(graph) -> None:
    """Keeps one of equal constants: the tracing exporter writes each number wherever it stands."""
    first, instead, nodes = {}, {}, []
    for node in graph.node:
        if node.op_type == "Constant":
            instead[node.output[0]] = first.setdefault(node.attribute[0].SerializeToString(), node.output[0])
        if node.op_type != "Constant" or instead[node.output[0]] == node.output[0]:
            nodes.append(node)
    del graph.node[:]
    graph.node.extend(nodes)
    replace_inputs(graph, instead)


def replace_inputs(graph, instead: dict) -> None:
    for node in graph.node:
        node.input[:] = [instead.get(name, name) for name in node.input]
        for attribute in node.attribute:
            if attribute.HasField("g"):
                replace_inputs(attribute.g, instead)


def rename_nodes(graph, rename) -> None:
    for number, node in enumerate(graph.node):
        node.name = f"{node.op_type}{number}"
        node.doc_string = ""
        del node.metadata_props[:]
        rename(node.input)
        rename(node.output)
        for attribute in node.attribute:
            attribute.doc_string = ""
            if attribute.HasField("g"):  # the branches of an If see the names around them
                rename_nodes(attribute.g, rename)
                rename_values(attribute.g.output, rename)
    rename_values(graph.initializer, rename)


def rename_values(values, rename) -> None:
    for value in values:
        names = [value.name]
        rename(names)
        value.name = names[0]


def set_shape(value, shape) -> None:
    dims = value.type.tensor_type.shape
    del dims.dim[:]
    for size in shape:
        dims.dim.add(**({"dim_param": size} if isinstance(size, str) else {"dim_value": size}))


def save_graph(model, path: pathlib.Path) -> None:
    """Writes the graph, with its weights in PATH.data where one file cannot hold them (`model` loses them then)."""
    with plain_errors(f"cannot write {path.name}"):
        if sum(len(tensor.raw_data) for tensor in model.graph.initializer) < INLINE_LIMIT:
            onnx.save(model, path)
        else:
            onnx.save(model, path, save_as_external_data=True, location=path.name + ".data", size_threshold=1024)


def run_graph(path: pathlib.Path, inputs: dict) -> dict:
    """Output name -> array of the graph at `path`, in onnxruntime on the CPU."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    options.intra_op_num_threads = torch.get_num_threads()
    with plain_errors(f"onnxruntime cannot run {path.name}"):
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        names = [o.name for o in session.get_outputs()]
        return dict(zip(names, session.run(None, {k: v.numpy() for k, v in inputs.items()})))


def differences(expected: "dict[str, torch.Tensor]", got: dict) -> dict:
    """Output -> largest difference, as part of the largest expected magnitude where that is above 1. Infinite values
    must be equal."""
    result = {}
    for name, value in expected.items():
        want, have = value.detach().numpy(), got[name]
        finite = np.isfinite(want)
        if want.shape != have.shape or not np.array_equal(want[~finite], have[~finite]):
            result[name] = float("inf")
        elif finite.any():
            scale = max(1.0, float(np.abs(want[finite]).max()))
            result[name] = float(np.abs(want[finite] - have[finite]).max()) / scale
        else:
            result[name] = 0.0
    return result


def check(what: str, expected: "dict[str, torch.Tensor]", got: dict) -> None:
    """Prints the differences; ends where one is above the limit."""
    found = differences(expected, got)
    values = ", ".join(f"{name} {value:.1e}" for name, value in found.items())
    print(f"{what}: largest differences: {values}", flush=True)
    worst = max(found, key=found.get)
    if not found[worst] <= LIMIT:
        fail(f"{what}: {worst} of the exported graph differs from PyTorch by {found[worst]:.1e}, limit {LIMIT:.0e}")


def file_entry(path: pathlib.Path) -> dict:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return {"file": path.name, "bytes": path.stat().st_size, "sha256": digest.hexdigest()}


def publish(folder: pathlib.Path, out: pathlib.Path, name: str) -> dict:
    """Moves a finished file, and the weights beside it, into the models folder. Returns its entry of models.json."""
    with plain_errors(f"cannot write {out / name}"):
        entry = file_entry(folder / name)
        data = folder / f"{name}.data"
        if data.exists():
            data.chmod(0o644)
            entry["data"] = [file_entry(data)]
            os.replace(data, out / data.name)
        else:
            (out / data.name).unlink(missing_ok=True)
        os.replace(folder / name, out / name)
    return entry


def read_manifest(out: pathlib.Path) -> dict:
    path = out / "models.json"
    if not path.exists():
        return {"format": FORMAT}
    with plain_errors(f"cannot read {path} (delete it to start anew)"):
        manifest = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        fail(f"{path} is not of format {FORMAT}: give another --out, or delete it")
    return manifest


def merge_manifest(out: pathlib.Path, part: str, value: dict) -> None:
    """Replaces `part` of models.json."""
    path = out / "models.json"
    manifest = read_manifest(out)
    manifest[part] = value
    with plain_errors(f"cannot write {path}"):
        partial = path.with_suffix(".json.partial")
        partial.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        os.replace(partial, path)
    print(f"{path}: {part} {value['source']}")
