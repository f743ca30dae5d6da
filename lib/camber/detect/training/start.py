"""A training's start from a network that export.py wrote, which may have fewer residual blocks."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from torch import Tensor, nn

from model import KeypointNetwork, Residual

CONVOLUTION = "/Conv"


def module_name(layer: str) -> str:
    """Of a layer of the ONNX file, "onnx_node!/fine/fine.0/first/first.0/Conv": fine.0.first.0."""
    scopes = layer.split("!")[-1].removesuffix(CONVOLUTION).strip("/").split("/")
    inner = [s for s, below in zip(scopes, scopes[1:] + [""]) if not below.startswith(s + ".")]
    return ".".join(inner)


def convolutions(file: Path) -> dict[str, tuple[Tensor, Tensor]]:
    """Weights and biases by the module's name, batch norms folded into them."""
    import cv2  # Debian's python3-opencv: here alone, so that a start from nothing does without it

    net = cv2.dnn.readNetFromONNX(str(file))
    found = {}
    for name in net.getLayerNames():
        layer = net.getLayer(net.getLayerId(name))
        if layer.type == "Convolution":
            weight, bias = (torch.from_numpy(blob.copy()) for blob in layer.blobs)
            found[module_name(name)] = weight, bias.flatten()
    return found


@torch.no_grad()
def start_from(network: KeypointNetwork, file: Path, images: Tensor) -> None:
    """Gives the network the function of the file's.

    Blocks that the file lacks add nothing at first. The batch norms, which the file has no longer, get
    the statistics of the images, (N, 3, 64, 64), and scales and offsets that undo them.
    """
    try:
        found = convolutions(file)
        spread_weight = json.loads(file.with_suffix(".json").read_text())["spread_weight"]
    except Exception as error:
        raise SystemExit(f"camber training: {file}: {error}") from error
    modules = dict(network.named_modules())
    for name, (weight, _) in found.items():
        mine = modules.get(name)
        if not isinstance(mine, nn.Conv2d) or mine.weight.shape != weight.shape:
            raise SystemExit(f"camber training: {file}: {name} {tuple(weight.shape)} has no place")
    biases: dict[nn.Module, Tensor] = {}
    for name, module in modules.items():
        if not isinstance(module, nn.Conv2d):
            continue
        if name in found:
            module.weight.copy_(found[name][0])
        if module.bias is not None:
            module.bias.copy_(found[name][1])
        elif name in found:
            biases[modules[name.removesuffix(".0") + ".1"]] = found[name][1]
    for name, module in modules.items():
        if isinstance(module, Residual) and f"{name}.second.0" not in found:
            nn.init.zeros_(module.second[1].weight)
    network.spread_weight.fill_(spread_weight)

    def undo(norm: nn.Module, inputs: tuple[Tensor]) -> None:
        assert isinstance(norm, nn.BatchNorm2d)
        variance, mean = torch.var_mean(inputs[0].float(), (0, 2, 3), unbiased=False)
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        if norm in biases:
            norm.weight.copy_((variance + norm.eps).sqrt())
            norm.bias.copy_(mean + biases[norm])

    training = network.training
    network.eval()
    hooks = [m.register_forward_pre_hook(undo) for m in modules.values() if isinstance(m, nn.BatchNorm2d)]
    network(images)
    for hook in hooks:
        hook.remove()
    network.train(training)
