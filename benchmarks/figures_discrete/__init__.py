"""What Guo et al. claim of separate particles, measured again:

    python -m benchmarks.figures_discrete --only fig16

One module for figures that ask the same.  Each has `measure() -> numbers`, `tables(numbers) -> {name: Markdown}` and
`draw(numbers) -> figure`; the command prints the tables, puts them into docs/discrete-claims.md and saves the pictures beside it.

The paper: J. Guo, B. Hu, Y. Chen, Y. Li, Y. Guo, L.-Q. Yan, Rendering discrete participating media using geometrical optics
approximation, Computational Visual Media 8, 425 (2022).  Numbers of equations and figures are its.
"""
