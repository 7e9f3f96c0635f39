"""The stub names what the module has, with the same parameters, and nothing else."""

import ast
import inspect
from pathlib import Path

import instgs

STUB = ast.parse((Path(__file__).parents[1] / "instgs.pyi").read_text())


def public(name):
    return not name.startswith("_") or name in ("__len__", "__version__")


def parameters(function):
    """Names of a stub's parameters, without self."""
    a = function.args
    names = [p.arg for p in [*a.posonlyargs, *a.args, *a.kwonlyargs]]
    return [name for name in names if name != "self"]


def members(body):
    """Functions, classes and values of a module or class, by name; of overloads and setters all."""
    out = {}
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            out.setdefault(node.name, []).append(node)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            out.setdefault(node.target.id, []).append(node)
    return out


def is_overload(node):
    return any(isinstance(d, ast.Name) and d.id == "overload" for d in node.decorator_list)


def check_function(node, live):
    want = [p for p in inspect.signature(live).parameters.values() if p.name != "self"]
    if is_overload(node):
        return
    assert parameters(node) == [p.name for p in want], node.name
    keyword_only = [p.arg for p in node.args.kwonlyargs]
    assert keyword_only == [p.name for p in want if p.kind is p.KEYWORD_ONLY], node.name


def test_the_module_has_what_the_stub_says():
    stub = members(STUB.body)
    typed = {name for name, (node, *_) in stub.items() if isinstance(node, ast.ClassDef) and node.bases}
    names = {name for name in stub if public(name)} - (typed - {"Error"})
    assert names == {name for name in vars(instgs) if public(name)} - {"instgs"}
    for name in names:
        for node in stub[name]:
            if isinstance(node, ast.FunctionDef):
                check_function(node, getattr(instgs, name))


def test_classes_have_what_the_stub_says():
    for name, (node, *_) in members(STUB.body).items():
        if not isinstance(node, ast.ClassDef) or node.bases:
            continue
        live, stub = getattr(instgs, name), members(node.body)
        assert live.__doc__, name
        assert {n for n in stub if public(n)} == {n for n in vars(live) if public(n)}, name
        for member, nodes in stub.items():
            if member == "__init__":
                check_function(nodes[0], live)
            elif callable(getattr(live, member)) and member != "__len__":
                assert getattr(live, member).__doc__, member
                for function in nodes:
                    check_function(function, getattr(live, member))


def test_every_error_is_an_exception_of_the_module():
    assert issubclass(instgs.Error, Exception) and instgs.Error.__module__ == "instgs"
