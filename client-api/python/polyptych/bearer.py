"""The proofs that a client and a manager know the wall's token, which itself never travels.

The functions are those of ``polyptych login``: BLAKE3 in its modes for derived keys and keyed
hashes. Python's standard library has no BLAKE3, so the part that is needed is here: inputs of one
chunk, at most 1024 bytes (J. O'Connor, J.-P. Aumasson, S. Neves, Z. Wilcox-O'Hearn, *BLAKE3: one
function, fast everywhere*, 2020).
"""

from __future__ import annotations

import hmac
import struct
from typing import List, Sequence, Tuple

_INITIAL: Tuple[int, ...] = (
    0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A,
    0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19,
)  # fmt: skip
_PERMUTATION: Tuple[int, ...] = (2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8)
_COLUMNS_AND_DIAGONALS: Tuple[Tuple[int, int, int, int], ...] = (
    (0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
    (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14),
)  # fmt: skip
_WORD = 0xFFFFFFFF
_BLOCK_BYTES = 64
_CHUNK_BYTES = 1024
_CHUNK_START, _CHUNK_END, _ROOT = 1, 2, 8
_KEYED_HASH, _DERIVE_KEY_CONTEXT, _DERIVE_KEY_MATERIAL = 16, 32, 64


def bearer(token: str) -> str:
    """Returns the bearer token of programs for a wall's token, as ``polyptych login --token``."""
    return _derive_key("polyptych 2026-11 http bearer token", token.encode()).hex()


def manager_proof(token: str, manager_nonce: str, client_nonce: str) -> str:
    """Returns the proof by which a manager shows that it knows the token."""
    key = _derive_key("polyptych 2026-11 http login", token.encode())
    message = b"\0"
    for nonce in (manager_nonce.encode(), client_nonce.encode()):
        message += struct.pack("<Q", len(nonce)) + nonce
    return _hash(message, struct.unpack("<8I", key), _KEYED_HASH).hex()


def is_same(one: str, other: str) -> bool:
    """Returns whether two secrets are equal, in a time that does not depend on them."""
    return hmac.compare_digest(one.encode(), other.encode())


def _derive_key(context: str, material: bytes) -> bytes:
    key = _hash(context.encode(), _INITIAL, _DERIVE_KEY_CONTEXT)
    return _hash(material, struct.unpack("<8I", key), _DERIVE_KEY_MATERIAL)


def _hash(message: bytes, key: Sequence[int], mode: int) -> bytes:
    if len(message) > _CHUNK_BYTES:
        raise ValueError(f"{len(message)} bytes to hash; at most {_CHUNK_BYTES} can be")
    blocks = [message[at : at + _BLOCK_BYTES] for at in range(0, len(message), _BLOCK_BYTES)]
    blocks = blocks or [b""]
    chaining: List[int] = list(key)
    for index, block in enumerate(blocks):
        flags = mode | (_CHUNK_START if index == 0 else 0)
        if index == len(blocks) - 1:
            flags |= _CHUNK_END | _ROOT
        chaining = _compress(chaining, block, flags)
    return struct.pack("<8I", *chaining)


def _compress(chaining: Sequence[int], block: bytes, flags: int) -> List[int]:
    words = list(struct.unpack("<16I", block.ljust(_BLOCK_BYTES, b"\0")))
    # The counter of the only chunk is 0.
    state = [*chaining, *_INITIAL[:4], 0, 0, len(block), flags]
    for _ in range(7):
        for step, (a, b, c, d) in enumerate(_COLUMNS_AND_DIAGONALS):
            _mix(state, (a, b, c, d), words[2 * step], words[2 * step + 1])
        words = [words[at] for at in _PERMUTATION]
    return [state[at] ^ state[at + 8] for at in range(8)]


def _mix(state: List[int], at: Tuple[int, int, int, int], first: int, second: int) -> None:
    a, b, c, d = at
    for word, turn_d, turn_b in ((first, 16, 12), (second, 8, 7)):
        state[a] = (state[a] + state[b] + word) & _WORD
        state[d] = _turned(state[d] ^ state[a], turn_d)
        state[c] = (state[c] + state[d]) & _WORD
        state[b] = _turned(state[b] ^ state[c], turn_b)


def _turned(word: int, bits: int) -> int:
    return ((word >> bits) | (word << (32 - bits))) & _WORD
