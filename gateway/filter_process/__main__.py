"""The template process, ``python -m gateway.filter_process FD``, begun without a garbage collector.

What is imported stays: looking through it again and again would take a fifth of the start.
"""

import gc
import sys
from importlib import import_module

gc.disable()
import_module("gateway.filter_process.template").main(int(sys.argv[1]))
