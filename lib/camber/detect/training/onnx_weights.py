"""The weights in an exported network's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx.numpy_helper
import torch
from torch import Tensor

# What the name of a weight that is stored in half precision ends in.
HALF = ".half"


def store_in_half_precision(file: Path) -> None:
    """Weights that half precision holds exactly: half the size. A cast makes them floats again."""
    model = onnx.load(str(file))
    graph = model.graph
    casts = []
    for stored in graph.initializer:
        values = onnx.numpy_helper.to_array(stored)
        halves = values.astype(np.float16)
        if values.dtype != np.float32 or values.ndim < 4 or not (halves == values).all():
            continue
        name = stored.name
        half = onnx.numpy_helper.from_array(halves, name + HALF)
        stored.CopyFrom(half)
        casts.append(onnx.helper.make_node("Cast", [half.name], [name], to=onnx.TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    onnx.save(model, str(file))


def convolutions(file: Path) -> dict[str, tuple[Tensor, Tensor]]:
    """Weights and biases by the module's name, batch norms folded into them."""
    values: dict[str, Tensor] = {}
    for stored in onnx.load(str(file)).graph.initializer:
        array = onnx.numpy_helper.to_array(stored).astype(np.float32)
        values[stored.name.removesuffix(HALF)] = torch.from_numpy(array)
    weights = {name.removesuffix(".weight"): w for name, w in values.items() if name.endswith(".weight")}
    return {name: (weight, values[name + ".bias"]) for name, weight in weights.items()}
