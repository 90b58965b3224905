"""What `rbd.worlds.lanes` is to Numba: a type of eight numbers, its arithmetic, loads and stores, as instructions of LLVM."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, overload, register_model, type_callable

from rbd.worlds.lanes import LANES, above, lane, lanes_of, largest, load, put_lane, root, spread, store

double, index = ir.DoubleType(), ir.IntType(32)
vector = ir.VectorType(double, LANES)

class Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")

lanes = Lanes()

@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, vector)

def spread_value(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, Lanes):
        return value
    number = context.cast(builder, value, kind, types.float64)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), number, ir.Constant(index, 0))
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(index, LANES), [0] * LANES))

def arithmetic(operation: Any, name: str) -> None:
    @type_callable(operation)
    def _typed(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            if any(isinstance(each, Lanes) for each in (a, b)) and all(isinstance(x, Lanes) or isinstance(x, types.Float | types.Integer) for x in (a, b)):
                return lanes
            return None

        return typer

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (spread_value(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True))
        return getattr(builder, name)(x, y, flags=("contract",))

    for pair in ((Lanes, Lanes), (Lanes, types.Float), (types.Float, Lanes), (Lanes, types.Integer), (types.Integer, Lanes)):
        lower_builtin(operation, *pair)(lower)

for operation, name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    arithmetic(operation, name)

@type_callable(operator.neg)
def _negated(context: Any) -> Any:
    return lambda a: lanes if isinstance(a, Lanes) else None

@lower_builtin(operator.neg, Lanes)
def _negate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])

def pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = context.make_array(sig.args[0])(context, builder, args[0])
    row = builder.mul(context.cast(builder, args[1], sig.args[1], types.intp), ir.Constant(ir.IntType(64), LANES))
    return builder.bitcast(builder.gep(array.data, [row]), vector.as_pointer())

@intrinsic
def load_lanes(typing: Any, a: Any, i: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(pointer(context, builder, sig, args))
        value.align = 8
        return value

    return lanes(a, i), code

@intrinsic
def store_lanes(typing: Any, a: Any, i: Any, x: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(spread_value(context, builder, sig.args[2], args[2]), pointer(context, builder, sig, args)).align = 8
        return context.get_dummy_value()

    return types.void(a, i, x), code

@intrinsic
def root_lanes(typing: Any, x: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(vector, [vector])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{LANES}f64"), args)

    return lanes(x), code

@intrinsic
def above_lanes(typing: Any, a: Any, b: Any, x: Any, y: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b, x, y = (spread_value(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True))
        return builder.select(builder.fcmp_ordered(">", a, b), x, y)

    return lanes(a, b, x, y), code

@intrinsic
def largest_lanes(typing: Any, x: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        top = ir.Constant(double, -np.inf)
        for k in range(LANES):
            y = builder.extract_element(args[0], ir.Constant(index, k))
            y = builder.select(builder.fcmp_ordered("==", y, y), y, ir.Constant(double, np.inf))
            top = builder.select(builder.fcmp_ordered(">", y, top), y, top)
        return top

    return types.float64(x), code

@intrinsic
def spread_lanes(typing: Any, x: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return spread_value(context, builder, sig.args[0], args[0])

    return lanes(x), code

@overload(load, strict=False, inline="always")
def _load(a: Any, i: Any) -> Any:
    return (lambda a, i: load_lanes(a, i)) if a.ndim == 2 else (lambda a, i: a[i])

@overload(store, strict=False, inline="always")
def _store(a: Any, i: Any, x: Any) -> Any:
    if a.ndim == 2:
        return lambda a, i, x: store_lanes(a, i, x)

    def one(a: Any, i: Any, x: Any) -> None:
        a[i] = x

    return one

@overload(root, strict=False, inline="always")
def _root(x: Any) -> Any:
    return (lambda x: root_lanes(x)) if isinstance(x, Lanes) else (lambda x: np.sqrt(x))

@overload(above, strict=False, inline="always")
def _above(a: Any, b: Any, x: Any, y: Any) -> Any:
    return (lambda a, b, x, y: above_lanes(a, b, x, y)) if any(isinstance(each, Lanes) for each in (a, b, x, y)) else (lambda a, b, x, y: x if a > b else y)

@overload(largest, strict=False, inline="always")
def _largest(x: Any) -> Any:
    return (lambda x: largest_lanes(x)) if isinstance(x, Lanes) else (lambda x: x if x == x else np.inf)

@overload(spread, strict=False, inline="always")
def _spread(a: Any, x: Any) -> Any:
    return (lambda a, x: spread_lanes(x)) if a.ndim == 2 else (lambda a, x: x)

@overload(lane, strict=False, inline="always")
def _lane(a: Any, i: Any, of: Any) -> Any:
    return (lambda a, i, of: a[i, of]) if a.ndim == 2 else (lambda a, i, of: a[i])

@overload(put_lane, strict=False, inline="always")
def _put_lane(a: Any, i: Any, of: Any, x: Any) -> Any:
    if a.ndim == 2:

        def many(a, i, of, x):
            a[i, of] = x

        return many

    def one(a, i, of, x):
        a[i] = x

    return one

@overload(lanes_of, strict=False, inline="always")
def _lanes_of(a: Any) -> Any:
    return (lambda a: LANES) if a.ndim == 2 else (lambda a: 1)
