"""CompletionFormer: Zhang et al., "CompletionFormer: Depth Completion with Convolutions and Vision
Transformers", CVPR 2023."""

from steered_marigold.methods.completionformer.completer import CompletionFormerCompleter
from steered_marigold.methods.completionformer.network import CompletionFormer

__all__ = ["CompletionFormer", "CompletionFormerCompleter"]
