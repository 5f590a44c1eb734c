"""GPUs for phasestereo, by Vulkan or Metal: ``ps.Matcher(device="gpu")`` opens one.

The GPU only searches for the best candidates; the processor does the rest, and also the search if
the GPU does not support it or has failed: the result is the same to the bit.
"""

from phasestereo_gpu._gpu import Gpu, __version__, adapters

__all__ = ["Gpu", "__version__", "adapters"]
