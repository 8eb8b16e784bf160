"""YAML files read strictly: its safe subset, and a key given twice is a mistake."""

from collections.abc import Iterable
from pathlib import Path

import yaml

from control.errors import ConfigError


class _StrictLoader(yaml.SafeLoader):
    """YAML's safe subset, in which a key given twice is a mistake instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            name = self.construct_object(key, deep=True)
            if isinstance(name, str) and name in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{name}' is given twice", key.start_mark)
            seen.add(str(name))
        return super().construct_mapping(node, deep)


def read_mapping(path: Path, what: str, keys: Iterable[str]) -> dict:
    """Content of a file whose top level is a mapping.

    Args:
        path: The file.
        what: What it is, with its article, for people: "a cell file".
        keys: What its top level may hold, for people.

    Raises:
        ConfigError: It cannot be read, is not YAML or not a mapping; says where.
    """
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{line}: not valid YAML ({error.problem or error.context})") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid YAML ({error})") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: {what} is a mapping with the keys {', '.join(keys)}")
    return content
