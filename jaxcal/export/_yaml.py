"""YAML as calibrations are written in it, read by PyYAML."""

from typing import Any

from .._errors import DataError

_LARGEST = 2**20  # characters


def parse(text: str) -> dict[str, Any]:
    r"""The mapping that a text holds. Tags of OpenCV are passed over.

    Raises
    ------
    DataError
        If it is not such a text, a key stands in it twice, or PyYAML is not installed; the message names the line.

    Examples
    --------
    >>> from jaxcal.export._yaml import parse
    >>> parse("%YAML:1.0\na: 1.0  # Hz\nb:\n  c: !!opencv-matrix\n    d: [1, 2]")
    {'a': 1.0, 'b': {'c': {'d': [1, 2]}}}
    """
    try:
        import yaml
    except ImportError as error:
        raise DataError('reading YAML needs PyYAML; install it with pip install "jaxcal[yaml]"') from error
    if len(text) > _LARGEST:
        raise DataError(f"the file has {len(text)} characters; a configuration has some thousands")

    class Loader(yaml.SafeLoader):
        def construct_mapping(self, node, deep=False):
            keys = [self.construct_object(key, deep=True) for key, _ in node.value]
            for (key, _), name in zip(node.value, keys, strict=True):
                if not isinstance(name, str) or keys.count(name) > 1:
                    raise DataError(f"line {key.start_mark.line + 1}: {name!r} is no name, or stands there twice")
            return super().construct_mapping(node, deep)

        def compose_node(self, parent, index):
            if self.check_event(yaml.AliasEvent):
                raise DataError(f"line {self.peek_event().start_mark.line + 1}: references have no place in a calibration")
            return super().compose_node(parent, index)

    Loader.add_multi_constructor("tag:yaml.org,2002:opencv", lambda loader, _, node: loader.construct_mapping(node, deep=True))
    try:
        # OpenCV's directive is not YAML
        found = yaml.load("\n".join("" if line.startswith("%YAML") else line for line in text.splitlines()), Loader)
    except yaml.YAMLError as error:
        raise DataError(f"the file is not YAML: {' '.join(str(error).split())}") from error
    except (RecursionError, ValueError) as error:  # lists within lists without end; a date or a number that is none
        if isinstance(error, DataError):
            raise
        raise DataError(f"the file is no configuration: {error}") from error
    if not isinstance(found, dict):
        raise DataError("the file holds no keys")
    return found
