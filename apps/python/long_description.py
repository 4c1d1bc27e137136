"""The README as package indexes show it, for pyproject.toml.

There, what it links lies in the repository that CITATION.cff names (repository-code), at this version.
Where it names none, pictures are left out and links are their texts, rather than leading nowhere.
"""

import re
from pathlib import Path

RELATIVE_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:)([^)]*)\)")


def field_of(citation, name):
    found = re.search(rf'^{name}: *"?([^"\n]*)', citation, flags=re.MULTILINE)
    return found[1] if found else None


def for_an_index(readme, citation):
    repository = field_of(citation, "repository-code")
    if repository is None:
        without_pictures = re.sub(rf"{RELATIVE_LINK.pattern}\n+(\*[^*]+\*\n+)?",  # and their captions
                                  lambda found: "" if found[1] else found[0], readme)
        return RELATIVE_LINK.sub(r"\2", without_pictures)
    version = field_of(citation, "version")
    return RELATIVE_LINK.sub(
        lambda link: f"{link[1]}[{link[2]}]({repository}/{'raw' if link[1] else 'blob'}/v{version}/{link[3]})", readme)


def dynamic_metadata(field, settings=None):
    """Called by scikit-build-core, in the folder of pyproject.toml."""
    readme, citation = (Path(name).read_text(encoding="utf-8") for name in ("README.md", "CITATION.cff"))
    return {"content-type": "text/markdown", "text": for_an_index(readme, citation)}
