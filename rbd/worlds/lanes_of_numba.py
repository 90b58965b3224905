"""What `rbd.worlds.lanes` is to Numba: a type of eight numbers, its arithmetic, loads and stores, as instructions of LLVM."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from rbd.worlds.lanes import LANES, above, lane, lanes_of, largest, load, put_lane, root, spread, store

DOUBLE, INDEX = ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(DOUBLE, LANES)


class Lanes(types.Type):
    """The type of a number of each lane."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


lanes = Lanes()


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


class Code:
    """What a function is compiled to: the builder of its instructions, its arguments and their types."""

    def __init__(self, context: Any, builder: Any, kinds: Any, args: Any) -> None:
        self.context, self.builder, self.kinds, self.args = context, builder, kinds, args

    def whole(self, i: int) -> Any:
        """Argument i as an integer."""
        return self.context.cast(self.builder, self.args[i], self.kinds[i], types.intp)

    def float(self, i: int) -> Any:
        """Argument i as a float."""
        return self.context.cast(self.builder, self.args[i], self.kinds[i], types.float64)

    def lanes(self, i: int) -> Any:
        """Argument i as a number of each lane."""
        if isinstance(self.kinds[i], Lanes):
            return self.args[i]
        nothing, zero = ir.Constant(VECTOR, ir.Undefined), ir.Constant(INDEX, 0)
        first = self.builder.insert_element(nothing, self.float(i), zero)
        return self.builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(INDEX, LANES), [0] * LANES))

    def number(self, i: int, kind: Any) -> Any:
        """Argument i as a number of a type."""
        return self.lanes(i) if isinstance(kind, Lanes) else self.float(i)

    def place(self, i: int, of: int | None = None) -> Any:
        """Where row i of the array, which is argument 0, is in memory; or one lane of it."""
        wide = self.kinds[0].ndim == 2
        data = self.context.make_array(self.kinds[0])(self.context, self.builder, self.args[0]).data
        at = self.whole(i)
        if wide:
            at = self.builder.mul(at, ir.Constant(at.type, LANES))
        if wide and of is not None:
            at = self.builder.add(at, self.whole(of))
        place = self.builder.gep(data, [at])
        return self.builder.bitcast(place, VECTOR.as_pointer()) if wide and of is None else place


def _typed(function: Any, kind: Callable[..., Any]) -> None:
    """Have Numba know the type of a function's result by those of its arguments (None: not these)."""

    class Typed(AbstractTemplate):
        # Numba asks what is for processors first: of its own, for + on anything, it asked dozens at each sum of lanes.
        key, metadata = function, {"target": "cpu"}

        def generic(self, args: Any, kws: Any) -> Any:
            return None if (result := kind(*args)) is None else signature(result, *args)

    infer_global(function)(Typed)


def _teach(function: Any, kind: Callable[..., Any], code: Callable[[Code, Any], Any]) -> None:
    """Have Numba compile a function: the type of its result, and its instructions."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return code(Code(context, builder, sig.args, args), sig.return_type)

    _typed(function, kind)
    lower_builtin(function, types.VarArg(types.Any))(lower)


def _common(*kinds: Any) -> Any:
    """The type of a number made of others."""
    return lanes if any(isinstance(kind, Lanes) for kind in kinds) else types.float64


def _row(a: Any) -> Any:
    return lanes if a.ndim == 2 else types.float64


def _load(code: Code, kind: Any) -> Any:
    value = code.builder.load(code.place(1))
    value.align = 8
    return value


def _store(code: Code, kind: Any) -> Any:
    code.builder.store(code.number(2, _row(code.kinds[0])), code.place(1)).align = 8
    return code.context.get_dummy_value()


def _root(code: Code, kind: Any) -> Any:
    size, name = (VECTOR, f"llvm.sqrt.v{LANES}f64") if isinstance(kind, Lanes) else (DOUBLE, "llvm.sqrt.f64")
    function = cgutils.get_or_insert_function(code.builder.module, ir.FunctionType(size, [size]), name)
    return code.builder.call(function, [code.number(0, kind)])


def _above(code: Code, kind: Any) -> Any:
    compared = _common(*code.kinds[:2])
    is_above = code.builder.fcmp_ordered(">", code.number(0, kind), code.number(1, kind))
    assert compared is kind or kind is lanes
    return code.builder.select(is_above, code.number(2, kind), code.number(3, kind))


def _largest(code: Code, kind: Any) -> Any:
    builder, top, many = code.builder, ir.Constant(DOUBLE, -np.inf), isinstance(code.kinds[0], Lanes)
    for k in range(LANES if many else 1):
        x = builder.extract_element(code.args[0], ir.Constant(INDEX, k)) if many else code.float(0)
        x = builder.select(builder.fcmp_ordered("==", x, x), x, ir.Constant(DOUBLE, np.inf))
        top = builder.select(builder.fcmp_ordered(">", x, top), x, top)
    return top


def _put_lane(code: Code, kind: Any) -> Any:
    code.builder.store(code.float(3), code.place(1, 2))
    return code.context.get_dummy_value()


_teach(load, lambda a, i: _row(a), _load)
_teach(store, lambda a, i, x: types.void, _store)
_teach(root, lambda x: _common(x), _root)
_teach(above, lambda a, b, x, y: _common(a, b, x, y), _above)
_teach(largest, lambda x: types.float64, _largest)
_teach(spread, lambda a, x: _row(a), lambda code, kind: code.number(1, kind))
_teach(lane, lambda a, i, of: types.float64, lambda code, kind: code.builder.load(code.place(1, 2)))
_teach(put_lane, lambda a, i, of, x: types.void, _put_lane)
_teach(
    lanes_of, lambda a: types.intp,
    lambda code, kind: ir.Constant(ir.IntType(64), LANES if code.kinds[0].ndim == 2 else 1),
)  # fmt: skip


def _arithmetic(operation: Any, name: str) -> None:
    """Of two numbers of which one has lanes, as one instruction; products and sums may become one (`contract`)."""

    def kind(a: Any, b: Any) -> Any:
        numbers = all(isinstance(x, Lanes | types.Float | types.Integer) for x in (a, b))
        return lanes if numbers and _common(a, b) is lanes else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = Code(context, builder, sig.args, args)
        return getattr(builder, name)(code.lanes(0), code.lanes(1), flags=("contract",))

    _typed(operation, kind)
    for pair in ((Lanes, Lanes), (Lanes, types.Float), (types.Float, Lanes), (Lanes, types.Integer), (types.Integer, Lanes)):
        lower_builtin(operation, *pair)(lower)


for _operation, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _arithmetic(_operation, _name)


_typed(operator.neg, lambda a: a if isinstance(a, Lanes) else None)


@lower_builtin(operator.neg, Lanes)
def _negate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])
