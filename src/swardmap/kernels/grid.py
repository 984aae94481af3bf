"""The update of the last-seen map, compiled."""

from swardmap.kernels.compiled import compiled


@compiled()
def merge(news, doubted, cells, grass_in_a_row, frames_to_clear):  # type: ignore[no-untyped-def]
    """Clear what was seen as grass often enough, mark, and forget what was free and is doubted.

    Without doubt the twin is grid.update_grid for one frame.

    Args:
        news: (h, w) uint8 MapClass, one frame's grid.
        doubted: (h, w) bool, cells that the frame saw and would not free.
        cells: (h, w) uint8 MapClass, the map's window; changed here.
        grass_in_a_row: (h, w) uint8 frames that saw grass since the last hazard; changed here.
        frames_to_clear: (4,) uint8 by MapClass of the cell.
    """
    for y in range(news.shape[0]):
        for x in range(news.shape[1]):
            new = news[y, x]
            if new == 1:
                seen = min(grass_in_a_row[y, x] + 1, 255)
                grass_in_a_row[y, x] = seen
                if seen >= frames_to_clear[cells[y, x]]:
                    cells[y, x] = 1
            elif new > 1:
                grass_in_a_row[y, x] = 0
                cells[y, x] = max(cells[y, x], new)  # a person stays one until grass is seen
            elif doubted[y, x] and cells[y, x] == 1:
                cells[y, x] = 0
