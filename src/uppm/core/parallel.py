"""Work on the next item while the last one is used; methods that one thread at a time runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial, wraps
from threading import RLock
from typing import Concatenate, ParamSpec, Protocol, TypeVar


class Locked(Protocol):
    """An object with a lock of its own."""

    lock: RLock


Item = TypeVar("Item")
Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")
Owner = TypeVar("Owner", bound=Locked)


def exclusive(
    method: Callable[Concatenate[Owner, Arguments], Result],
) -> Callable[Concatenate[Owner, Arguments], Result]:
    """Let a method hold its object's lock while it runs."""

    @wraps(method)
    def holding(self: Owner, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with self.lock:
            return method(self, *args, **kwargs)

    return holding


def run_ahead(
    function: Callable[[Item], Result], items: Iterable[Item], *, ahead: bool
) -> Iterator[tuple[Item, Callable[[], Result]]]:
    """Each item and what gives its result, or raises as `function` did.

    With `ahead`, one thread works on the next item from the moment that this one is given out; items are worked on one
    after another and in order either way. Otherwise the result is computed when it is asked for.
    """
    if not ahead:
        for item in items:
            yield item, partial(function, item)
        return
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="uppm-ahead") as pool:
        pending = ((item, pool.submit(function, item)) for item in items)
        current = next(pending, None)
        while current is not None:
            item, future = current
            future.exception()  # waits, so that only one item is ahead
            current = next(pending, None)
            yield item, future.result
