"""Idioms that make prose hard to follow: found by pattern, counted as a share of sentences."""

import re

# Not forbidden words; a page where many sentences have one reads like a private language.
_IDIOMS = re.compile(
    r"""
    \b(?:told|tells?|stands?|stood|beside|hears?|heard|lies?|asked)\b
    | \b(?:nobody|whoever|as\ people|by\ what)\b
    | (?:^|[,;:]\s)what\ (?:is|was|it|they|no|a)\b
    | \bthat\ (?:it|they)\ (?:is|are|stands?)\ (?:of|in|at)\b
    | \b(?:fix|fixes|rows?|ms|s|milliseconds|seconds|times|lines?|values?|once|one|code)\ a\ (?:scan|drive|tick)\b
    | ^(?:of\ it|of\ these)\b
    | ^no\ \w+\ (?:is|does)\b
    | \bcarrot\b
    """,
    re.IGNORECASE | re.VERBOSE,
)
_BLOCK = re.compile(r"^```.*?^```|^<!--.*?-->|^---\n.*?^---\n", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"``[^`]+``|`[^`\n]+`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
# A sentence ends with its full stop or colon, with its paragraph, or with its cell of a table.
_ENDS = re.compile(r"(?<=[.!?:])\s+(?=[A-Z*\"(\[])|\n\s*\n|\n(?=\s*(?:[-*#>|]|\d+\. ))|\s\|\s?")


def sentences_of(markdown: str) -> list[str]:
    """Sentences, headings and cells of a page, without code, link targets and emphasis; at least three words each."""
    text = _LINK.sub(r"\1", _CODE.sub("X", _BLOCK.sub("\n\n", markdown)))
    parts = (re.sub(r"[*#>|_]+|^\s*-\s", " ", part).split() for part in _ENDS.split(text) if part)
    return [" ".join(words) for words in parts if len(words) >= 3]


def idioms_in(markdown: str) -> list[str]:
    """The sentences with an idiom."""
    return [sentence for sentence in sentences_of(markdown) if _IDIOMS.search(sentence)]
