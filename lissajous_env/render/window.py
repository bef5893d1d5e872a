"""The window, the only module that uses the display."""

import pygame

from lissajous_env.render.text import plain


class Window:
    """A window of a given size [px]. After the user closes it, `show` does nothing.

    What else in the process closes it, as another environment that ends pygame, does not count: it is opened again.

    Raises:
        OSError: there is no display to open a window on.
    """

    def __init__(self, size: tuple[int, int], caption: str):
        self.closed = False
        self._size, self._caption = size, plain(caption)
        self._clock = pygame.time.Clock()
        self._open()

    def _open(self) -> None:
        try:
            pygame.display.init()
            pygame.display.set_caption(self._caption)
            self._screen = pygame.display.set_mode(self._size)
        except pygame.error as error:
            raise OSError(f"no window can be opened ({error}); draw to rgb_array or to a file instead") from error

    def show(self, picture: pygame.Surface, fps: float) -> None:
        """Show a picture for at least 1 / `fps` seconds."""
        if self.closed:
            return
        screen = pygame.display.get_surface() if pygame.display.get_init() else None
        if screen is None or screen is not self._screen or screen.get_size() != self._size:
            self._open()  # other code has quit pygame or replaced its window
        self._screen.blit(picture, (0, 0))
        pygame.display.flip()
        self._clock.tick(fps)
        for event in pygame.event.get():
            if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
                self.close()

    def close(self) -> None:
        """Close the window."""
        if not self.closed:
            self.closed = True
            pygame.display.quit()
