"""The template process, ``python -m gateway.filter_process FD``, begun without a garbage collector.

What is imported stays: looking through it again and again would take a fifth of the start.
"""

import gc
import os
import sys
from importlib import import_module

gc.disable()
import_module("gateway.filter_process.template").main(int(sys.argv[1]))
os._exit(0)  # taking apart what was compiled here, and not read from the cache, takes two seconds
