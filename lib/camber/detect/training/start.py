"""A training's start from a network that export.py wrote, which may have fewer residual blocks, no
convolution before its maps and an input of half the size."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from torch import Tensor, nn

from model import KeypointNetwork, Residual
from onnx_weights import convolutions

HEAD = "head.0"


@torch.no_grad()
def start_from(network: KeypointNetwork, file: Path, images: Tensor) -> None:
    """Gives the network the function of the file's.

    Blocks that the file lacks add nothing at first; a head that it lacks hands its inputs on, and its
    other channels have no weight in the maps. Detail that it lacks has none in the stem, which reads
    the means of 2 x 2 px. The batch norms, which the file has no longer, get
    the statistics of the images, (N, 3, side, side), and scales and offsets that undo them.
    """
    try:
        found = convolutions(file)
        spread_weight = json.loads(file.with_suffix(".json").read_text())["spread_weight"]
    except Exception as error:
        raise SystemExit(f"camber training: {file}: {error}") from error
    modules = dict(network.named_modules())
    if len(network.head) and HEAD not in found and "maps" in found:
        head = network.head[0]
        nn.init.dirac_(head.weight[: head.in_channels])
        found[HEAD] = head.weight, torch.zeros(head.out_channels)
        weight, bias = found["maps"]
        added = torch.zeros(len(weight), head.out_channels - head.in_channels, 1, 1)
        found["maps"] = torch.cat([weight, added], 1), bias
    stem = network.stem[0]
    if "detail.0" not in found and "stem.0" in found and network.widths.detail:
        weight, bias = found["stem.0"]
        added = torch.zeros(len(weight), stem.in_channels - weight.shape[1], *weight.shape[2:])
        found["stem.0"] = torch.cat([weight, added], 1), bias
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
