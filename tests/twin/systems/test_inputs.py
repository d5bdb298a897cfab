"""Ports read the quick way say what `Eval` says, and name what is not connected."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.twin.systems.inputs import input_object, input_values


class Reader(LeafSystem):
    """A vector input and an abstract one."""

    def __init__(self):
        super().__init__()
        self.numbers = self.DeclareVectorInputPort("numbers", 3)
        self.thing = self.DeclareAbstractInputPort("thing", AbstractValue.Make(object()))


def test_fixed_inputs_are_what_eval_says():
    reader = Reader()
    context = reader.CreateDefaultContext()
    reader.numbers.FixValue(context, [1.0, 2.0, 3.0])
    value = AbstractValue.Make(object())
    thing = {"any": "object"}
    value.set_value(thing)
    reader.thing.FixValue(context, value)
    np.testing.assert_array_equal(input_values(reader, context, 0), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(input_values(reader, context, 0), reader.numbers.Eval(context))
    assert input_object(reader, context, 1) == thing == reader.thing.Eval(context)


def test_connected_inputs_are_the_sources():
    builder = DiagramBuilder()
    reader = builder.AddSystem(Reader())
    source = builder.AddSystem(ConstantVectorSource([4.0, 5.0, 6.0]))
    builder.Connect(source.get_output_port(), reader.numbers)
    diagram = builder.Build()
    context = reader.GetMyContextFromRoot(diagram.CreateDefaultContext())
    np.testing.assert_array_equal(input_values(reader, context, 0), [4.0, 5.0, 6.0])


@pytest.mark.parametrize(
    ("read", "index", "name"), [(input_values, 0, "numbers"), (input_object, 1, "thing")]
)
def test_what_is_not_connected_is_named(read, index, name):
    reader = Reader()
    with pytest.raises(RuntimeError, match=name):
        read(reader, reader.CreateDefaultContext(), index)
