"""BP-Net: Tang et al., "Bilateral Propagation Network for Depth Completion", CVPR 2024."""

from steered_marigold.methods.bpnet.completer import BPNetCompleter
from steered_marigold.methods.bpnet.network import BPNet

__all__ = ["BPNet", "BPNetCompleter"]
