"""Changes the last gates one place at a time and asks whether the tests notice.

`python tests/link/mutants.py [FILE…] [--workers N]` prints every change that no test notices; those that
remain are explained in SURVIVORS.md. Needs a system with `fork`. No test itself: it takes minutes.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

HERE = Path(__file__).parent
ROOM = HERE.parent.parent / "omnimj" / "link"
DEVICE = ("device/test_device_limits.py", "device/test_device_arming.py", "device/test_device_commands.py")
TARGETS = {
    "device/limits.py": DEVICE,
    "device/state_machine.py": (*DEVICE[1:], "device/test_device_any_order.py"),
    "device/config.py": ("host/test_host.py",),
    "host/state_machine.py": ("host/test_host.py",),
    "quality.py": ("host/test_host.py", "host/test_link_quality.py"),
}
LONGEST = 60  # [s]: a mutant that runs for ever has been noticed

SWAPS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.Pow: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.LShift: (ast.RShift,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
}
CALLS = {"max": "min", "min": "max", "all": "any", "any": "all", "abs": "float"}

Change = tuple[str, Callable[[ast.AST], ast.AST | None]]


def changed(node: ast.AST, **fields) -> ast.AST:
    new = copy.copy(node)
    for name, value in fields.items():
        setattr(new, name, value)
    return new


def changes_of(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What may be put in the node's place, with words for it."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in SWAPS.get(type(op), ()):
                ops = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                yield f"{type(op).__name__} → {other.__name__}", changed(node, ops=ops)
    elif isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp):
        for other in SWAPS.get(type(node.op), ()):
            yield f"{type(node.op).__name__} → {other.__name__}", changed(node, op=other())
    elif isinstance(node, ast.UnaryOp):
        yield f"without {type(node.op).__name__}", node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} → {not node.value}", changed(node, value=not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        for value in {node.value + 1, node.value * 1.01 if isinstance(node.value, float) else 0} - {
            node.value
        }:
            yield f"{node.value} → {value}", changed(node, value=value)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CALLS:
        other = CALLS[node.func.id]
        yield f"{node.func.id} → {other}", changed(node, func=changed(node.func, id=other))
    elif isinstance(node, ast.If | ast.IfExp | ast.While):
        yield "condition negated", changed(node, test=ast.UnaryOp(ast.Not(), node.test))
    if isinstance(node, ast.Expr | ast.Assign | ast.AugAssign | ast.AnnAssign | ast.Raise):
        yield "statement removed", ast.Pass()
    if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
        yield "returns None", changed(node, value=ast.Constant(None))


def sites(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Every place that may be changed: parent, field, index. Not: texts, annotations, imports, decorators."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list", "bases", "names"):
            continue
        for index, node in enumerate(value) if isinstance(value, list) else ((None, value),):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                continue  # a docstring
            if isinstance(node, ast.AST):
                yield tree, field, index
                yield from sites(node)


def mutants(source: str) -> Iterator[tuple[int, str, str]]:
    """Line, words and source of every mutant."""
    tree = ast.parse(source)
    for parent, field, index in list(sites(tree)):
        holder = getattr(parent, field)
        node = holder if index is None else holder[index]
        for words, new in changes_of(node):
            new = ast.copy_location(copy.copy(new), node)
            if index is None:
                setattr(parent, field, new)
            else:
                holder[index] = new
            text = ast.unparse(ast.fix_missing_locations(tree))
            if index is None:
                setattr(parent, field, node)
            else:
                holder[index] = node
            yield getattr(node, "lineno", 0), words, text


class Overlay(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module another source."""

    def __init__(self, name: str, source: str):
        self._name, self._source = name, source

    def find_spec(self, name, path, target=None):
        return importlib.util.spec_from_loader(name, self) if name == self._name else None

    def exec_module(self, module):
        exec(compile(self._source, self._name, "exec"), module.__dict__)


def noticed(name: str, source: str, tests: tuple[str, ...]) -> bool:
    """Whether a test fails with this source, in a separate process."""
    child = os.fork()
    if child == 0:
        signal.alarm(LONGEST)
        code = 1
        try:
            import pytest

            sys.meta_path.insert(0, Overlay("omnimj.link." + name[:-3].replace("/", "."), source))
            files = [str(HERE / test) for test in tests]
            quiet = ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # hypothesis is loaded already
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                code = pytest.main(["-x", "-q", "-p", "no:cacheprovider", "--no-header", *quiet, *files])
        finally:
            os._exit(int(code))
    _, status = os.waitpid(child, 0)
    return status != 0


def main() -> int:
    import hypothesis.stateful  # noqa: F401  loaded once, before the forks
    import pytest  # noqa: F401

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", default=list(TARGETS))
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    os.environ["CI"] = "1"  # the same examples for every mutant
    survivors = 0
    for name in given.files:
        source = (ROOM / name).read_text(encoding="utf-8")
        if noticed(name, source, TARGETS[name]):
            raise SystemExit(f"{name}: its tests fail without any change")
        found = list(mutants(source))
        with ThreadPoolExecutor(given.workers) as pool:
            waiting = [pool.submit(noticed, name, text, TARGETS[name]) for _, _, text in found]
            results = [one.result() for one in waiting]
        alive = [m for m, killed in zip(found, results, strict=True) if not killed]
        print(f"{name}: {len(found)} mutants, {len(alive)} not noticed", flush=True)
        lines = source.splitlines()
        for line, words, _ in alive:
            print(f"  {line}: {words}: {lines[line - 1].strip()}", flush=True)
        survivors += len(alive)
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
