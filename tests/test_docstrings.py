"""Examples in docstrings of the library, run as they stand there."""

import doctest
from importlib import import_module

import pytest

import ttempc

DATA = {"__version__", "CONTROLLERS", "ESTIMATORS", "TtempcError"}
SELF_EVIDENT = {  # protocols, enumerations and plain data, shown in the examples of others
    "ConstantSpeed",
    "ControlStep",
    "Controller",
    "Diagnostics",
    "Estimate",
    "Estimator",
    "Input",
    "ProcessNoise",
    "Sensor",
    "State",
}
SHOWN = sorted(set(ttempc.__all__) - DATA - SELF_EVIDENT)


@pytest.mark.parametrize("name", SHOWN)
def test_examples_of_public_names_run(name):
    item = getattr(ttempc, name)
    module = import_module(item.__module__)
    names = {**vars(module), "Vehicle": ttempc.Vehicle}
    examples = doctest.DocTestFinder(recurse=False).find(item, name, module, names)
    assert examples[0].examples, f"{name} has no example"
    assert doctest.DocTestRunner().run(examples[0]).failed == 0
