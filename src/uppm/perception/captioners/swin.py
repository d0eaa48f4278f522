"""Swin Transformer (Liu et al., ICCV 2021), with the names of its authors' checkpoints; a module for back ends alone.

Shapes: B images, L tokens in rows of the grid, C channels; windows of M x M tokens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

PATCH = 4
"""Side of a patch, pixels."""
MLP_RATIO = 4


@dataclass(frozen=True, kw_only=True)
class SwinSize:
    """What tells one Swin from another."""

    image: int
    """Side of the square input, pixels."""
    width: int
    """Channels of the first stage; each next one has twice as many."""
    depths: tuple[int, ...]
    """Blocks a stage."""
    heads: tuple[int, ...]
    window: int
    """M."""

    @property
    def channels(self) -> int:
        """Of the output."""
        return self.width << (len(self.depths) - 1)


SWIN_B = SwinSize(image=384, width=128, depths=(2, 2, 18, 2), heads=(4, 8, 16, 32), window=12)
SWIN_L = SwinSize(image=384, width=192, depths=(2, 2, 18, 2), heads=(6, 12, 24, 48), window=12)


class Swin(nn.Module):
    """Image (B, 3, S, S) -> their mean and all tokens of the last stage (B, 1 + L, C)."""

    def __init__(self, size: SwinSize) -> None:
        super().__init__()
        self.patch_embed = PatchEmbedding(size.width)
        grid, stages = size.image // PATCH, len(size.depths)
        self.layers = nn.ModuleList(
            Stage(grid >> i, size.width << i, size.depths[i], size.heads[i], size.window, last=i == stages - 1)
            for i in range(stages)
        )
        self.norm = nn.LayerNorm(size.channels)

    def forward(self, image: Tensor) -> Tensor:
        tokens = self.patch_embed(image)
        for layer in self.layers:
            tokens = layer(tokens)
        tokens = self.norm(tokens)
        return torch.cat([tokens.mean(dim=1, keepdim=True), tokens], dim=1)


class PatchEmbedding(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, width, kernel_size=PATCH, stride=PATCH)
        self.norm = nn.LayerNorm(width)

    def forward(self, image: Tensor) -> Tensor:
        return self.norm(self.proj(image).flatten(2).transpose(1, 2))


class Stage(nn.Module):
    """Blocks whose windows lie on the grid and shifted by half a window in turn; then, but for the last, merging."""

    def __init__(self, grid: int, width: int, depth: int, heads: int, window: int, *, last: bool) -> None:
        super().__init__()
        # A grid no larger than a window is one window, and there is nothing to shift.
        side, shift = (grid, 0) if grid <= window else (window, window // 2)
        self.blocks = nn.ModuleList(Block(grid, width, heads, side, shift * (i % 2)) for i in range(depth))
        self.downsample = None if last else PatchMerging(grid, width)

    def forward(self, tokens: Tensor) -> Tensor:
        for block in self.blocks:
            tokens = block(tokens)
        return tokens if self.downsample is None else self.downsample(tokens)


class Block(nn.Module):
    def __init__(self, grid: int, width: int, heads: int, window: int, shift: int) -> None:
        super().__init__()
        self._grid, self._window, self._shift = grid, window, shift
        self.norm1 = nn.LayerNorm(width)
        self.attn = WindowAttention(width, heads, window)
        self.norm2 = nn.LayerNorm(width)
        self.mlp = Mlp(width)
        self.register_buffer("mask", shift_mask(grid, window, shift) if shift else None, persistent=False)

    def forward(self, tokens: Tensor) -> Tensor:
        batch, _, width = tokens.shape
        image = self.norm1(tokens).view(batch, self._grid, self._grid, width)
        shift = self._shift
        if shift:
            image = image.roll((-shift, -shift), dims=(1, 2))
        windows = self.attn(partition(image, self._window), self.mask)
        image = merge(windows, self._window, self._grid)
        if shift:
            image = image.roll((shift, shift), dims=(1, 2))
        tokens = tokens + image.reshape(batch, -1, width)
        return tokens + self.mlp(self.norm2(tokens))


class WindowAttention(nn.Module):
    """Self-attention in windows (B * W, M * M, C), with a learned bias for each relative position."""

    index: Tensor

    def __init__(self, width: int, heads: int, window: int) -> None:
        super().__init__()
        self._heads = heads
        self.relative_position_bias_table = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)
        self.register_buffer("index", relative_index(window), persistent=False)

    def forward(self, windows: Tensor, mask: Tensor | None) -> Tensor:
        count, length, width = windows.shape
        q, k, v = self.qkv(windows).view(count, length, 3, self._heads, -1).permute(2, 0, 3, 1, 4)
        bias = self.relative_position_bias_table[self.index].permute(2, 0, 1)
        if mask is not None:
            bias = (bias[None] + mask[:, None].to(bias.dtype)).repeat(count // len(mask), 1, 1, 1)
        out = functional.scaled_dot_product_attention(q, k, v, attn_mask=bias.expand(count, -1, -1, -1))
        return self.proj(out.transpose(1, 2).reshape(count, length, width))


class Mlp(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(width, MLP_RATIO * width)
        self.fc2 = nn.Linear(MLP_RATIO * width, width)

    def forward(self, tokens: Tensor) -> Tensor:
        return self.fc2(functional.gelu(self.fc1(tokens)))


class PatchMerging(nn.Module):
    """Four neighbours (by columns: upper left, lower left, upper right, lower right) become one token of 2 C."""

    def __init__(self, grid: int, width: int) -> None:
        super().__init__()
        self._grid = grid
        self.reduction = nn.Linear(4 * width, 2 * width, bias=False)
        self.norm = nn.LayerNorm(4 * width)

    def forward(self, tokens: Tensor) -> Tensor:
        batch, _, width = tokens.shape
        half = self._grid // 2
        cells = tokens.view(batch, half, 2, half, 2, width).permute(0, 1, 3, 4, 2, 5)
        return self.reduction(self.norm(cells.reshape(batch, half * half, 4 * width)))


def partition(image: Tensor, window: int) -> Tensor:
    """(B, G, G, C) -> windows (B * (G / M)^2, M * M, C)."""
    batch, grid, _, width = image.shape
    n = grid // window
    return image.view(batch, n, window, n, window, width).transpose(2, 3).reshape(-1, window * window, width)


def merge(windows: Tensor, window: int, grid: int) -> Tensor:
    """The inverse of `partition`."""
    n, width = grid // window, windows.shape[-1]
    return windows.view(-1, n, n, window, window, width).transpose(2, 3).reshape(-1, grid, grid, width)


def relative_index(window: int) -> Tensor:
    """(M * M, M * M): row of the bias table for each pair of tokens of a window."""
    # On the CPU whatever the default: a network made without memory must still have what no checkpoint brings.
    side = torch.arange(window, device="cpu")
    rows, columns = side.repeat_interleave(window), side.repeat(window)
    down, right = rows[:, None] - rows, columns[:, None] - columns
    return (down + window - 1) * (2 * window - 1) + right + window - 1


def shift_mask(grid: int, window: int, shift: int) -> Tensor:
    """(W, M * M, M * M): -100 between tokens that only the cyclic shift made neighbours, else 0."""
    edges = torch.tensor([0, grid - window, grid - shift], device="cpu")
    region = (torch.arange(grid, device="cpu")[:, None] >= edges).sum(dim=1)
    regions = (3 * region[:, None] + region)[None, :, :, None]
    number = partition(regions, window)[:, :, 0]
    return (number[:, None] != number[:, :, None]) * -100.0


TRAINING_BUFFERS: Sequence[str] = ("relative_position_index", "attn_mask")
"""What checkpoints hold of a Swin beside its weights: both follow from the architecture."""
