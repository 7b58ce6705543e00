"""What Wang, Ge & Holzschuch claim of tables of multiple scattering, measured again, and what boundaries do to them:

    python -m benchmarks.figures_translucent --only fig32 --size 32 --share 0.2

One module a claim, as in `benchmarks.figures_granular`: `measure(size, share) -> numbers`, `tables(numbers) -> {name: Markdown}`
and `draw(numbers) -> figure`; the command prints the tables, puts them into docs/translucent-claims.md (those of a module with a
PAGE there) and saves the pictures beside it.

The paper: B. Wang, L. Ge, N. Holzschuch, Precomputed multiple scattering for rapid light simulation in participating media, IEEE
Transactions on Visualization and Computer Graphics 26 (2020), published 2018.  Numbers of equations and figures are its.
"""
