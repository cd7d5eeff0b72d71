"""Create a layout for PlotJuggler 3 (XML).

Source: layouts that PlotJuggler saves; elements of an array are named `key[i]`.
"""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from dpr_lab.storage.viewers.curves import COLORS, PLOTS


def plotjuggler() -> str:
    """Create a layout for PlotJuggler as XML: one tab with plots one below the other."""
    root = Element("root")
    tabs = SubElement(root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"})
    container = SubElement(SubElement(tabs, "Tab", tab_name="dpr-lab", containers="1"), "Container")
    shares = ";".join([f"{1 / len(PLOTS):.6f}"] * len(PLOTS))
    column = SubElement(container, "DockSplitter", orientation="-", sizes=shares, count=str(len(PLOTS)))
    for title, curves in PLOTS.items():
        area = SubElement(column, "DockArea", name=title)
        plot = SubElement(area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false")
        SubElement(plot, "limitY")
        for number, (topic, key, element) in enumerate(curves):
            name = f"{topic}/{key}" + ("" if element is None else f"[{element}]")
            SubElement(plot, "curve", name=name, color=COLORS[number])
    SubElement(tabs, "currentTabIndex", index="0")
    indent(root)
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{tostring(root, encoding='unicode')}\n"
