import typing

import numpy as np

from armguard.jit import arrays


def test_kernels_see_the_types_that_signatures_name():
    kinds = {"FloatArray": np.zeros(2), "IntArray": np.arange(2), "BoolArray": np.zeros(2, bool)}
    for name, array in kinds.items():
        _, kind = typing.get_args(getattr(arrays, name))
        assert typing.get_args(kind) == (array.dtype.type,)
