"""The commands of `mtu` and their options; each is imported when it runs: --help is quick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from mtu_cli import __version__
from mtu_cli.cli import graph_parameters as g
from mtu_cli.cli import parameters as p
from mtu_cli.cli.budget_parameters import BUDGET
from mtu_cli.cli.options import Commands, Options, register
from mtu_cli.cli.simulate_parameters import SIMULATE
from mtu_cli.close_loop_sealed.cli.close_loop_parameters import CLOSE_LOOP

app = typer.Typer(
    name="mtu",
    cls=Commands,
    help="Machine tool uncertainty: from measurements of a machine and of its parts to "
    "statements with uncertainty.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _lazily(module: str) -> Callable[[Options], None]:
    """The `run` of a command module, imported at the call."""

    def run(options: Options) -> None:
        from importlib import import_module

        folder = "close_loop_sealed.cli" if module == "close_loop" else "cli"
        command = import_module(f"mtu_cli.{folder}.{module}")
        from mtu_cli.cli.places import placed_faults

        with placed_faults(options):
            command.run(options)

    return run


def _version(asked: bool) -> None:
    if asked:
        print(f"mtu {__version__}")
        raise typer.Exit


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


PREDICTED = [
    p.STUDY,
    p.PART,
    p.COMPONENTS,
    p.READINGS,
    p.DRIFT,
    p.AT,
    p.COVERAGE,
    p.CORRELATION,
]
PREDICTION = [*PREDICTED, p.MONTE_CARLO]
UNUSUAL = p.fail_if("unusual, an outlier among the parts")
FOUND = p.fail_if("found, unexplained")
OFF = p.fail_if("biased, under-predicted")
MACHINE, PART, BEYOND, ABOUT = (
    "The machine",
    "Predictions for a part",
    "Measured parts",
    "Uncertainty, files and help",
)

register(
    app,
    "fit-components",
    [p.STUDY, p.READINGS, p.COVERAGE, p.OUTPUT, p.fail_if("drift")],
    _lazily("fit_components"),
    "Readings to coefficients, covariance, repeatability, drift, reversal, per component.",
    MACHINE,
)
register(
    app,
    "thermal-fit",
    [p.STUDY, p.DRIFT, p.THERMAL_MODEL, p.OUTPUT, p.fail_if()],
    _lazily("thermal_fit"),
    "Drift readings with temperatures to a thermal model per component.",
    MACHINE,
)
register(
    app,
    "predict-points",
    [*PREDICTION, p.GRID, p.COVARIANCE, p.OUTPUT, p.fail_if()],
    _lazily("predict_points"),
    "Error and uncertainty of every feature of a part.",
    PART,
)
register(
    app,
    "lengths",
    [*PREDICTION, p.OUTPUT, p.fail_if("nonconforming=0.01")],
    _lazily("lengths"),
    "Feature-to-feature lengths with uncertainty and probability of conformance.",
    PART,
)
register(
    app,
    "orthogonality",
    [*PREDICTION, p.OUTPUT, p.fail_if()],
    _lazily("orthogonality"),
    "Right angles between rows and columns of features, by Monte Carlo and first order.",
    PART,
)
register(
    app,
    "anova",
    [p.STUDY, p.PART, p.CMM, p.METHOD, p.DATUM, p.COVERAGE, p.SEED, p.OUTPUT, UNUSUAL],
    _lazily("anova"),
    "Measured parts: part-to-part and CMM scatter of features, lengths and right angles.",
    BEYOND,
)
register(
    app,
    "close-loop",
    [
        *[p.STUDY, p.PART, p.COMPONENTS, p.READINGS, p.CMM, p.DRIFT, p.AT],
        *[p.DATUM, CLOSE_LOOP, p.SEED, p.OUTPUT, FOUND],
    ],
    _lazily("close_loop"),
    "Measured minus model: effects that the machine does not declare, named and added to it.",
    BEYOND,
)
register(
    app,
    "compare",
    [*PREDICTION, p.CMM, p.DATUM, p.OUTPUT, OFF],
    _lazily("compare"),
    "Predicted against measured parts: means, scatter, ratios, a verdict for each.",
    BEYOND,
)
register(
    app,
    "correct",
    [*PREDICTED, p.CMM, p.OUTPUT, p.fail_if()],
    _lazily("correct"),
    "Measured points minus the modelled error; rings and lengths before and after.",
    BEYOND,
)
register(
    app,
    "budget",
    [BUDGET, p.MONTE_CARLO, p.OUTPUT],
    _lazily("budget"),
    "An uncertainty budget: first and second order, and Monte Carlo beside them.",
    ABOUT,
)
register(
    app,
    "simulate",
    [p.STUDY, p.PART, p.COMPONENTS, p.SEED, SIMULATE, p.QUIET],
    _lazily("simulate"),
    "A virtual machine: synthetic readings and points, with any effect, seeded.",
    MACHINE,
)
graph = typer.Typer(
    cls=Commands,
    help="The measurement graph: its soundness, picture, uncertainty, and what that follows.",
    no_args_is_help=True,
)
app.add_typer(graph, name="graph", rich_help_panel=ABOUT)
register(
    graph,
    "check",
    [g.FILE, g.WITHOUT_PLOT],
    _lazily("graph"),
    "Whether a graph is sound, with all its faults at once; and its firing order.",
)
register(
    graph,
    "draw",
    [g.FILE, g.TO, g.OF_SHARES],
    _lazily("graph_draw"),
    "The graph as a picture, or as text for other programs.",
)
register(
    graph,
    "simulate",
    [g.FILE, g.OF_MANY, p.COVERAGE, p.MONTE_CARLO, p.OUTPUT],
    _lazily("graph"),
    "Uncertainty of the graph's places by Monte Carlo, and where it comes from.",
)
register(
    graph,
    "sweep",
    [g.FILE, g.VARY, g.OF_ONE, p.COVERAGE, p.MONTE_CARLO, p.OUTPUT],
    _lazily("graph"),
    "Uncertainty of one place over a grid of probing uncertainties, with a formula.",
)
register(
    app,
    "schema",
    [p.KIND],
    _lazily("schema"),
    "The JSON Schema of a YAML contract, for editors.",
    ABOUT,
)
register(
    app,
    "help",
    [p.TOPIC],
    _lazily("help"),
    "Topics, the meaning of a warning or error, and the options of a command.",
    ABOUT,
)
