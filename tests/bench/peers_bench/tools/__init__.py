"""Which packages take part, in which forms; imports none of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from peers_bench.problem import Found, Inputs

MonteCarlo = Callable[[Inputs, int, int, int | None], Found]
"""(inputs, trials, seed, threads or None for the package's own choice)."""
FirstOrder = Callable[[Inputs], tuple[float, float]]
"""Value and standard uncertainty, rad."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """A package in one `form`: the module here that calls it has `MONTE_CARLO` and `FIRST_ORDER`,
    each with those forms that the package has. `slow`: timed with a fifth of the trials, times 5.
    """

    package: str
    form: str
    module: str
    monte_carlo: bool = True
    first_order: bool = True
    slow: bool = False

    @property
    def name(self) -> str:
        return f"{self.package} ({self.form})" if self.form else self.package

    @property
    def installed(self) -> str | None:
        """The version; None where it is not installed."""
        try:
            return version({"mtu": "mtu-cli", "bare": "numpy"}.get(self.package, self.package))
        except PackageNotFoundError:
            return None


BARE = Tool(package="bare", form="", module="bare", first_order=False)
OURS = Tool(package="mtu", form="", module="with_mtu")
ADAPTIVE = Tool(package="mtu", form="count adapts", module="with_mtu", first_order=False)
PEERS = (
    Tool(package="suncal", form="callable", module="with_suncal"),
    Tool(package="suncal", form="expression", module="with_suncal"),
    Tool(package="metrolopy", form="operators", module="with_metrolopy"),
    Tool(package="metrolopy", form="function", module="with_metrolopy", slow=True),
    Tool(package="openturns", form="symbolic", module="with_openturns"),
    Tool(package="openturns", form="Python", module="with_openturns", slow=True),
    Tool(package="GTC", form="", module="with_gtc", monte_carlo=False),
    Tool(package="uncertainties", form="", module="with_uncertainties", monte_carlo=False),
)


def tool_named(name: str) -> Tool:
    return next(tool for tool in (BARE, OURS, ADAPTIVE, *PEERS) if tool.name == name)
