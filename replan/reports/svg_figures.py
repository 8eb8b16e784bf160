"""Figures of the pages that reports are: one look for all, as SVG text."""

import io

INK, ALLOWED, BROKEN, QUIET = "#1f4e79", "#d08700", "#c62828", "#9aa5b1"
LEFT, RIGHT, BOTTOM = 0.75, 0.12, 0.42  # margins of a figure in inches


def figure_of(rows: int, columns: int, size: tuple[float, float], top: float = 0.3, wide: float = 0.06):
    """An empty figure and its axes, in the pages' style.

    Args:
        rows, columns: Of axes.
        size: (width, height) in inches.
        top: Room above the axes in inches.
        wide: Room between columns, in widths of one.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    FigureCanvasSVG(figure)
    width, height = size
    # Margins in inches by hand: a layout engine draws everything twice.
    room = {"left": LEFT / width, "right": 1 - RIGHT / width, "bottom": BOTTOM / height, "top": 1 - top / height}
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={**room, "hspace": 0.42, "wspace": wide})
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=7, length=2)
        ax.title.set_fontsize(8)
        ax.xaxis.label.set_fontsize(8)
        ax.yaxis.label.set_fontsize(9)
    return figure, axes


def svg_text(figure) -> str:
    """A figure as SVG text; equal figures give equal text."""
    import matplotlib

    out = io.StringIO()
    # Text stays text: it is smaller than outlines, and can be searched. Fixed ids make equal reports equal files.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "replan", "font.family": "sans-serif"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]
