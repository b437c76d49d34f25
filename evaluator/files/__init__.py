"""Files of all kinds: written whole or not at all, read with one sentence for all faults."""

from evaluator.files.overwriting import refuse_to_lose, refuse_to_replace
from evaluator.files.reading import explain, in_words, quoted, read_with, refuse_stream, toml_fault
from evaluator.files.writing import named_from, plain, write_bytes, write_image, write_text, written_whole

__all__ = [
    "explain",
    "in_words",
    "named_from",
    "plain",
    "quoted",
    "read_with",
    "refuse_stream",
    "refuse_to_lose",
    "refuse_to_replace",
    "toml_fault",
    "write_bytes",
    "write_image",
    "write_text",
    "written_whole",
]
