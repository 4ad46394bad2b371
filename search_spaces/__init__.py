"""Search spaces: what to sweep, as plain data, each number with its source in the paper."""

from search_spaces.domains import Grid, Range
from search_spaces.loading import built_in, load, parse
from search_spaces.narrow import narrow
from search_spaces.safe_yaml import read_yaml, scalar
from search_spaces.search_space import SearchSpace

__all__ = ["Grid", "Range", "SearchSpace", "built_in", "load", "narrow", "parse", "read_yaml", "scalar"]
