"""The types that checkers see are those of the module in Rust, and say the same words as its help."""

import ast
import inspect
import re
import unittest
from pathlib import Path

import ecmsk
from ecmsk import _ecmsk, errors

STUBS = ast.parse(Path(ecmsk.__file__).with_name("_ecmsk.pyi").read_text())


def public(names):
    return {name for name in names if not name.startswith("_")}


def parameters(node):
    arguments = node.args
    names = [argument.arg for argument in arguments.posonlyargs + arguments.args + arguments.kwonlyargs]
    return [name for name in names if name != "self"]


class Stubs(unittest.TestCase):
    def is_the_same(self, node, found):
        self.assertEqual(inspect.getdoc(found) or None, ast.get_docstring(node), node.name)
        if isinstance(node, ast.ClassDef) or not callable(found):
            return
        signature = inspect.signature(found).parameters.values()
        if any(parameter.kind == parameter.VAR_KEYWORD for parameter in signature):
            return
        self.assertEqual([p.name for p in signature if p.name != "self"], parameters(node), node.name)

    def test_classes(self):
        for node in STUBS.body:
            if not isinstance(node, ast.ClassDef):
                continue
            found = getattr(_ecmsk, node.name)
            if ast.get_docstring(node):
                self.is_the_same(node, found)
            members = {member.name: member for member in node.body if isinstance(member, ast.FunctionDef)}
            values = {member.target.id for member in node.body if isinstance(member, ast.AnnAssign)}
            self.assertEqual(public(dir(found)), public(members) | public(values), node.name)
            for name in public(members):
                if ast.get_docstring(members[name]):
                    self.is_the_same(members[name], getattr(found, name))

    def test_functions(self):
        there = {node.name: node for node in STUBS.body if isinstance(node, ast.FunctionDef)}
        classes = {node.name for node in STUBS.body if isinstance(node, ast.ClassDef)}
        self.assertEqual(public(vars(_ecmsk)), set(there) | classes)
        for name, node in there.items():
            self.is_the_same(node, getattr(_ecmsk, name))

    def test_every_error_has_its_class(self):
        source = Path(__file__).parents[2].joinpath("src/errors.rs").read_text()
        names = set(re.findall(r'=> "(\w+)"', source))
        self.assertGreater(len(names), 25)
        for name in names:
            self.assertTrue(issubclass(getattr(errors, name), ecmsk.EcmError), name)


if __name__ == "__main__":
    unittest.main()
