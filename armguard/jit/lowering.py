"""How a kernel's code is written for LLVM: as Numba does, in fewer steps.

Numba infers the types of a whole function, and those of each operator again while it writes code.
It copies what describes an array to memory to read one number of it, reads all of that to count a
reference, compiles a function for the lesser of two numbers, and asks LLVM for the size of each
variable by a module of its own. LLVM takes most of that out again. What kernels compute is the same
to the bit: each number is read, and goes through the same operations.
"""

from __future__ import annotations

import operator
from typing import Any

from numba import types as numba_types
from numba.core import cgutils as numba_cgutils
from numba.core import ir as numba_ir
from numba.core import lowering as numba_lowering
from numba.core.runtime import context as numba_runtime
from numba.cpython import builtins as numba_builtins
from numba.np import arrayobj as numba_arrayobj

from armguard.jit.handle import HandleType, read_field
from armguard.jit.operators import EXTREMES, OperatorTypes

# Numba's functions are untyped: they are called as anything is.
arrayobj: Any = numba_arrayobj
builtins: Any = numba_builtins
cgutils: Any = numba_cgutils
ir: Any = numba_ir
lowering: Any = numba_lowering
runtime: Any = numba_runtime
types: Any = numba_types

NUMBERS = types.Number, types.Boolean
"""What an item can be whose address is written at once."""

_sizes: dict[Any, int] = {}
"""[bytes], of LLVM's types."""
_counted: dict[Any, bool] = {}
"""Whether references are counted to anything in a value, by its type."""


class Owners(runtime.NRTContext):  # type: ignore[misc]  # a class of unknown type
    """Finds what counts the references to a value, and reads nothing else of it."""

    def get_meminfos(self, builder: Any, kind: Any, value: Any) -> list[tuple[Any, Any]]:
        """Type and owner of all that a value consists of and references are counted to."""
        fields = self._context.data_model_manager[kind]
        if kind not in _counted:
            _counted[kind] = fields.contains_nrt_meminfo()
        if not _counted[kind]:
            return []
        if isinstance(kind, types.Array):
            return [(kind, builder.extract_value(value, fields.get_field_position("meminfo")))]
        found: list[tuple[Any, Any]] = super().get_meminfos(builder, kind, value)
        return found


class Lower(lowering.Lower):  # type: ignore[misc]  # a class of unknown type
    """Writes the code of one function."""

    def init(self) -> None:
        """Called at the end of the constructor."""
        super().init()
        self._operators = OperatorTypes(self.context.typing_context, self.flags)
        self._borrowed: set[str] = set()
        measure = self.context.get_abi_sizeof

        def find_size(kind: Any) -> int:
            if kind not in _sizes:
                _sizes[kind] = measure(kind)
            return _sizes[kind]

        # The context is a copy, for this function alone.
        self.context.get_abi_sizeof = find_size
        self.context.nrt = Owners(self.context, self.context.enable_nrt)

    def lower_assign(self, resty: Any, inst: Any) -> Any:
        """Write an assignment."""
        value = inst.value
        if isinstance(value, ir.Expr) and value.op == "getattr":
            kind = self.typeof(value.value.name)
            if isinstance(kind, HandleType):
                self._borrowed.add(inst.target.name)
                return self._write_field(resty, kind, value)
        return super().lower_assign(resty, inst)

    def _write_field(self, resty: Any, kind: Any, expr: Any) -> Any:
        """Write how a handle's field is read."""
        address = self.loadvar(expr.value.name)
        field = read_field(self.context, self.builder, kind, address, expr.attr)
        found = kind.fields[expr.attr].kind if expr.attr in kind.fields else kind
        return self.context.cast(self.builder, field, found, resty)

    def delvar(self, name: str) -> None:
        """Write what follows the last use of a variable: nothing, if its value is borrowed."""
        if not (name in self._borrowed and name in self._blk_local_varmap):
            super().delvar(name)

    def _lower_call_normal(self, fnty: Any, expr: Any, signature: Any) -> Any:
        """Write a call; that of an extreme of numbers as Numba does, but no function for it."""
        compare = EXTREMES.get(getattr(fnty, "typing_key", None))
        if compare is None or not all(isinstance(kind, types.Number) for kind in signature.args):
            return super()._lower_call_normal(fnty, expr, signature)
        values = self.fold_call_args(fnty, signature, expr.args, expr.vararg, expr.kws)
        return builtins.do_minmax(self.context, self.builder, signature.args, values, compare)

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Write an operator of two operands."""
        if expr.static_lhs is not ir.UNDEFINED or expr.static_rhs is not ir.UNDEFINED:
            # A power of a constant, for example, is written in other ways.
            return super().lower_binop(resty, expr, op)
        signature = self.fndesc.calltypes[expr]
        made = self._write_operator(op, signature, expr.lhs, expr.rhs)
        return self.context.cast(self.builder, made, signature.return_type, resty)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Write how an item is read."""
        kind, index_kind = signature.args
        if _is_single(kind, index_kind):
            place = self._find_item(value, kind, index, index_kind)
            item = arrayobj.load_item(self.context, self.builder, kind, place)
        else:
            item = self._write_operator(operator.getitem, signature, value, index)
        return self.context.cast(self.builder, item, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write how an item is set."""
        kind, index_kind, given = signature.args
        if not (_is_single(kind, index_kind) and isinstance(given, NUMBERS)):
            return self._write_operator(
                operator.setitem, signature, target_var, index_var, value_var
            )
        value = self.context.cast(self.builder, self._load(value_var, given), given, kind.dtype)
        place = self._find_item(target_var, kind, index_var, index_kind)
        return arrayobj.store_item(self.context, self.builder, kind, value, place)

    def _write_operator(self, function: Any, signature: Any, *operands: Any) -> Any:
        """Write an operator of which the signature was inferred.

        Args:
            function: The operator.
            signature: Of the operands' types.
            operands: Variables.
        """
        kind = self._operators.find_operator(function)
        found = self._operators.resolve_function_type(kind, signature.args, {})
        write = self.context.get_function(kind, found)
        return write(self.builder, list(map(self._load, operands, signature.args)))

    def _find_item(self, array: Any, kind: Any, index: Any, index_kind: Any) -> Any:
        """Address of one item; a negative index counts from the end.

        Args:
            array: Variable that holds the array.
            kind: As which it is read.
            index: Variable that holds an integer, or one for each axis.
            index_kind: As which it is read.
        """
        builder, fields = self.builder, self.context.data_model_manager[kind]
        loaded, indices = self._load(array, kind), [self._load(index, index_kind)]
        if isinstance(index_kind, types.BaseTuple):
            indices = cgutils.unpack_tuple(builder, indices[0], index_kind.count)
        data, shape, strides = (
            builder.extract_value(loaded, fields.get_field_position(name))
            for name in ("data", "shape", "strides")
        )
        return cgutils.get_item_pointer2(
            self.context,
            builder,
            data,
            cgutils.unpack_tuple(builder, shape, kind.ndim),
            cgutils.unpack_tuple(builder, strides, kind.ndim),
            kind.layout,
            indices,
            wraparound=True,
            boundscheck=self.context.enable_boundscheck,
        )

    def _load(self, variable: Any, kind: Any) -> Any:
        """A variable's value, as one of this type."""
        value = self.loadvar(variable.name)
        return self.context.cast(self.builder, value, self.typeof(variable.name), kind)


def _is_single(kind: Any, index: Any) -> bool:
    """Whether an index of this type names one number of an array of this type."""
    indices = index.types if isinstance(index, types.BaseTuple) else (index,)
    return (
        isinstance(kind, types.Array)
        and isinstance(kind.dtype, NUMBERS)
        and len(indices) == kind.ndim > 0
        and all(one == types.int64 for one in indices)
    )
