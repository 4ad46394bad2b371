"""The JSON Schema of search spaces, for editors; docs/search-space.schema.json is its published copy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from search_spaces.domains import Strict
from search_spaces.field_docs import field_docs
from search_spaces.search_space import SearchSpace

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a search space's YAML file; it does not check the names of tasks and agents."""
    schema = SearchSpace.model_json_schema(by_alias=True, mode="validation")
    for model in _below(Strict):
        part = schema if model is SearchSpace else schema["$defs"].get(model.__name__, {})
        properties = part.get("properties", {})
        for name, text in field_docs(model).items():
            if name in properties:
                properties[name]["description"] = text
    return {"$schema": DIALECT, **schema, "title": "deltatune search space"}


def _below(model: type[Strict]) -> Iterator[type[Strict]]:
    """Yield the classes derived from `model`."""
    for derived in model.__subclasses__():
        yield derived
        yield from _below(derived)
