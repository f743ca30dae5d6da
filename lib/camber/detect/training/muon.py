"""Steps along momentum that was made orthogonal: Jordan et al., "Muon: An optimizer for hidden layers in
neural networks", 2024. Their length is that of Liu et al., "Muon is scalable for LLM training", 2025,
section 2.2, with which AdamW's rate and decay fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor

# An odd polynomial of the fifth degree that brings singular values in (0, 1] near 1 (Jordan et al.).
LINEAR, CUBIC, QUINTIC = 3.4445, -4.7750, 2.0315
ITERATIONS = 5
UPDATE_RMS = 0.2  # of AdamW's steps, in units of the rate


def orthogonalised(matrix: Tensor, precision: torch.dtype = torch.float32) -> Tensor:
    """About U V^T of the matrix U S V^T, (N, M): Newton and Schulz's iteration."""
    wide = matrix.shape[0] <= matrix.shape[1]
    x = matrix if wide else matrix.T
    x = (x / (x.norm() + 1e-12)).to(precision)
    for _ in range(ITERATIONS):
        gram = x @ x.T
        polynomial = torch.addmm(gram, gram, gram, beta=CUBIC, alpha=QUINTIC)
        x = torch.addmm(x, polynomial, x, beta=LINEAR)
    return (x if wide else x.T).float()


class Muon(torch.optim.Optimizer):
    """For weights of two dimensions and more, the first the outputs."""

    def __init__(
        self, parameters: Iterable[Tensor], lr: float, momentum: float = 0.95,
        weight_decay: float = 0.0, precision: torch.dtype = torch.float32,
    ) -> None:  # fmt: skip
        super().__init__(
            parameters, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay}
        )
        self.precision = precision

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:
        assert closure is None
        for group in self.param_groups:
            for weight in group["params"]:
                if weight.grad is None:
                    continue
                state = self.state[weight]
                if not state:
                    state["mean"] = torch.zeros_like(weight)
                mean = state["mean"].lerp_(weight.grad, 1.0 - group["momentum"])
                ahead = torch.lerp(weight.grad, mean, group["momentum"])  # Nesterov's
                outputs, inputs = weight.shape[0], weight[0].numel()
                update = orthogonalised(ahead.reshape(outputs, inputs), self.precision)
                length = UPDATE_RMS * max(outputs, inputs) ** 0.5
                weight.mul_(1.0 - group["lr"] * group["weight_decay"])
                weight.add_(update.reshape(weight.shape), alpha=-group["lr"] * length)
