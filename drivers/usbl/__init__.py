"""Wire formats of ultra-short-baseline acoustic systems, one module each."""
