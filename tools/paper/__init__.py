"""The experiments of the paper: their runs, figures and claims, and the page about them.

python -m tools.paper run       train the experiments
python -m tools.paper report    write the page and the figures from the finished runs

The files of results/ that these commands do not write come from `python -m tools.paper.behavior` and
`python -m tools.paper.videos`.
"""
