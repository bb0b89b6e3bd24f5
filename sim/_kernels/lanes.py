"""Vector type of eight numbers, which guarantees vector instructions in kernels.

The values of the eight quadrature points of an element, or of its eight nodes, are adjacent in the
rows of an array. The compiler can seldom prove that arrays are distinct, and then does not
vectorise loops over them; a value of this type is one register of the processor (or two, or four).

    x, y = load(rows, 0), load(rows, 1)
    store(rows, 2, math.sqrt(x * x + y * y) + 1.0)

Laws are written for one number and can be evaluated for lanes as well.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportOptionalCall=false, reportPrivateImportUsage=false
# numba calls these functions during compilation with its own types.

import math
import operator

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, overload, register_model

from sim._kernels.options import allocating

LANES = 8
_BYTES = 8 * LANES  # of a cache line, too
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_SINGLE = ir.VectorType(ir.FloatType(), LANES)
_INT = ir.IntType(32)
_UNDEFINED = ir.Constant(_VECTOR, ir.Undefined)
# Types of this target are tried before those of numba and numpy, whose many attempts would
# otherwise take most of the time of a compilation.
_FIRST = {"target": "cpu"}


class LanesType(types.Type):
    """Type of eight float64; a number is converted to eight equal ones."""

    def __init__(self):
        super().__init__(name="Lanes")

    def can_convert_from(self, typingctx, other):
        """Unify branches that return numbers and lanes."""
        return Conversion.safe if isinstance(other, types.Float) else None


lanes = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VECTOR)


def _shuffled(builder, vector, order):
    mask = ir.Constant(ir.VectorType(_INT, LANES), list(order))
    return builder.shuffle_vector(vector, _UNDEFINED, mask)


def _spread(builder, number):
    return _shuffled(builder, builder.insert_element(_UNDEFINED, number, _INT(0)), [0] * LANES)


@lower_cast(types.float64, lanes)
def _number_to_lanes(context, builder, fromty, toty, value):
    return _spread(builder, value)


def _arithmetic(op, instruction):
    @infer_global(op)
    class _Operator(AbstractTemplate):
        metadata = _FIRST

        def generic(self, args, kws):
            of_lanes = [t == lanes for t in args]
            if any(of_lanes) and all(t == lanes or isinstance(t, types.Number) for t in args):
                return signature(lanes, *(lanes if t else types.float64 for t in of_lanes))
            return None

    def lower(context, builder, sig, args):
        pair = (
            x if t == lanes else _spread(builder, x) for t, x in zip(sig.args, args, strict=True)
        )
        return getattr(builder, instruction)(*pair)

    for left, right in ((lanes, lanes), (lanes, types.float64), (types.float64, lanes)):
        lower_builtin(op, left, right)(lower)


for _name in ("add", "sub", "mul", "truediv"):
    for _op in (getattr(operator, _name), getattr(operator, "i" + _name)):
        _arithmetic(_op, "f" + _name.removeprefix("true"))


@infer_global(operator.neg)
class _Negation(AbstractTemplate):
    metadata = _FIRST

    def generic(self, args, kws):
        return signature(lanes, lanes) if args == (lanes,) else None


@lower_builtin(operator.neg, lanes)
def _negate(context, builder, sig, args):
    return builder.fneg(args[0])


def _elementwise(function):
    """Extend a function of `math` to lanes, lane by lane if there is no instruction."""

    @intrinsic
    def call(typingctx, x):
        def codegen(context, builder, sig, args):
            kind = ir.FunctionType(_VECTOR, [_VECTOR])
            name = f"llvm.{function.__name__}.v{LANES}f64"
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

        return lanes(lanes), codegen

    @overload(function)
    def on_lanes(x):
        return (lambda x: call(x)) if isinstance(x, LanesType) else None


for _function in (math.sqrt, math.exp, math.log):
    _elementwise(_function)


def _row(context, builder, array_type, array, row):
    struct = cgutils.create_struct_proxy(array_type)(context, builder, value=array)
    stride = cgutils.unpack_tuple(builder, struct.strides)[0]
    start = builder.bitcast(struct.data, ir.IntType(8).as_pointer())
    kind = _SINGLE if array_type.dtype == types.float32 else _VECTOR
    return builder.bitcast(builder.gep(start, [builder.mul(row, stride)]), kind.as_pointer())


@intrinsic
def load(typingctx, array, row):
    """Lanes from a row of eight, array[row, :], also of one in single precision."""

    def codegen(context, builder, sig, args):
        single = sig.args[0].dtype == types.float32
        vector = builder.load(_row(context, builder, sig.args[0], *args), align=4 if single else 8)
        return builder.fpext(vector, _VECTOR) if single else vector

    return lanes(array, types.intp), codegen


@intrinsic
def store(typingctx, array, row, value):
    """Write array[row, :] = value, lanes, rounded if the array is in single precision."""

    def codegen(context, builder, sig, args):
        single = sig.args[0].dtype == types.float32
        value = builder.fptrunc(args[2], _SINGLE) if single else args[2]
        builder.store(
            value, _row(context, builder, sig.args[0], *args[:2]), align=4 if single else 8
        )
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), codegen


@intrinsic
def fetch(typingctx, array, index):
    """Prefetch the cache line of array[index] for writing; array has one axis."""

    def codegen(context, builder, sig, args):
        struct = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0])
        line = builder.bitcast(builder.gep(struct.data, [args[1]]), ir.IntType(8).as_pointer())
        flag = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [line.type, flag, flag, flag])
        call = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(call, [line, flag(1), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen


def _folded(builder, vector, join):
    for half in (4, 2, 1):
        other = _shuffled(builder, vector, [(i + half) % LANES for i in range(LANES)])
        vector = join(vector, other)
    return builder.extract_element(vector, _INT(0))


@intrinsic
def total(typingctx, x):
    """Sum of the lanes in a fixed order; NaN if one is NaN."""

    def codegen(context, builder, sig, args):
        return _folded(builder, args[0], builder.fadd)

    return types.float64(x), codegen


@intrinsic
def smallest(typingctx, x):
    """Smallest of the lanes; undefined if one is NaN."""

    def codegen(context, builder, sig, args):
        return _folded(
            builder, args[0], lambda a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b)
        )

    return types.float64(x), codegen


@intrinsic
def above(typingctx, x, limit, a, b):
    """Return a where x > limit, otherwise b; of a number, or of every lane."""
    kind = lanes if x == lanes else types.float64

    def codegen(context, builder, sig, args):
        pairs = zip(sig.args, args, strict=True)
        x, limit, a, b = (v if t == kind else _spread(builder, v) for t, v in pairs)
        return builder.select(builder.fcmp_ordered(">", x, limit), a, b)

    return kind(*(t if t == kind else types.float64 for t in (x, limit, a, b))), codegen


@intrinsic
def largest(typingctx, x):
    """Largest of the lanes, undefined if one is NaN; or the number."""

    def codegen(context, builder, sig, args):
        if sig.args[0] != lanes:
            return args[0]
        return _folded(
            builder, args[0], lambda a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b)
        )

    return types.float64(x if x == lanes else types.float64), codegen


@intrinsic
def _at_cache_line(typingctx, array):
    """View of the array from the next cache line, without its last row."""

    def codegen(context, builder, sig, args):
        made = context.make_array(sig.args[0])(context, builder, value=args[0])
        number = context.get_value_type(types.intp)
        address = builder.add(builder.ptrtoint(made.data, number), number(_BYTES - 1))
        address = builder.and_(address, number(-_BYTES))
        made.data = builder.inttoptr(address, made.data.type)
        context.nrt.incref(builder, sig.return_type, made._getvalue())
        return made._getvalue()

    return array(array), codegen


@allocating
def rows(n):
    """Array of n rows of lanes aligned to a cache line."""
    return _at_cache_line(np.empty((n + 1, LANES)))
