"""Looks things up in the job file's JSON Schema along a path: which keys exist there, how long, what they mean."""

from __future__ import annotations

from typing import Any

from mirelight.io.job.positions import Path


class Outline:
    """A JSON Schema, walked together with data, because a light's keys depend on its type."""

    def __init__(self, schema: dict[str, Any]) -> None:
        self._schema = schema

    def keys(self, path: Path, data: Any) -> list[str]:
        """The keys of the table at `path`; empty where the schema has no table."""
        tables = [node for node in self._nodes(path, data) if "properties" in node]
        return list(dict.fromkeys(key for table in tables for key in table["properties"]))

    def description(self, path: Path, data: Any) -> str:
        """What the key at `path` means; empty where the schema does not say."""
        parents = [node for node in self._nodes(path[:-1], data) if path[-1] in node.get("properties", {})]
        return str(parents[0]["properties"][path[-1]].get("description", "")) if parents else ""

    def lengths(self, path: Path, data: Any) -> tuple[int | None, int | None]:
        """The least and the largest length of the list at `path`."""
        for node in self._nodes(path, data):
            if node.get("type") == "array":
                return node.get("minItems"), node.get("maxItems")
        return None, None

    def kinds(self, path: Path, data: Any) -> list[str]:
        """The values of `type` that the table at `path` may have."""
        tables = self._nodes(path, data)
        return [t["properties"]["type"]["const"] for t in tables if "type" in t.get("properties", {})]

    def _nodes(self, path: Path, data: Any) -> list[dict[str, Any]]:
        """The alternatives that the schema allows at `path`, narrowed by the `type` that the data has there."""
        nodes, here = self._alternatives(self._schema), data
        for part in path:
            nodes = [inner for node in nodes for inner in self._step(node, part)]
            here = self._inside(here, part)
            of_kind = [n for n in nodes if isinstance(here, dict) and _kind(n) == here.get("type", _UNSAID)]
            nodes = of_kind or nodes
        return nodes

    @staticmethod
    def _inside(data: Any, part: str | int) -> Any:
        if isinstance(data, dict):
            return data.get(part)
        return data[part] if isinstance(data, list) and isinstance(part, int) and part < len(data) else None

    def _step(self, node: dict[str, Any], part: str | int) -> list[dict[str, Any]]:
        inner = node.get("items") if isinstance(part, int) else node.get("properties", {}).get(part)
        return self._alternatives(inner) if inner is not None else []

    def _alternatives(self, node: dict[str, Any]) -> list[dict[str, Any]]:
        if "$ref" in node:
            return self._alternatives(self._schema["$defs"][node["$ref"].rsplit("/", 1)[-1]])
        options = node.get("anyOf") or node.get("oneOf")
        return [x for option in options for x in self._alternatives(option)] if options else [node]


_UNSAID = "perspective"  # the only kind that has a default is a camera's


def _kind(table: dict[str, Any]) -> object:
    return table.get("properties", {}).get("type", {}).get("const")
