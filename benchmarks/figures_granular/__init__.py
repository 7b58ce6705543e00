"""What Meng et al. claim of granular materials, measured again:

    python -m benchmarks.figures_granular --only fig9

One module a figure, as in `benchmarks.figures_discrete`: `measure() -> numbers`, `tables(numbers) -> {name: Markdown}` and
`draw(numbers) -> figure`; the command prints the tables, puts them into docs/granular-claims.md and saves the pictures beside it.

The paper: J. Meng, M. Papas, R. Habel, C. Dachsbacher, S. Marschner, M. Gross, W. Jarosz, Multi-scale modeling and rendering of
granular materials, ACM Transactions on Graphics 34, 49 (2015).  Numbers of equations and figures are its.
"""
