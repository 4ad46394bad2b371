"""The JSON Schema of search spaces, for editors; docs/search-space.schema.json is its published copy."""

from __future__ import annotations

from typing import Any

from search_spaces.search_space import SearchSpace

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a search space's YAML file; it does not check the names of tasks and agents."""
    schema = SearchSpace.model_json_schema(by_alias=True, mode="validation")
    return {"$schema": DIALECT, **schema, "title": "deltatune search space"}
