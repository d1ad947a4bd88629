"""Mirror maps of vectors as signed permutations, and coordinates in which a mirror image only changes signs.

Every vector of the learner has a mirror image x' = F x: entries change places and signs, and twice the image is the
vector itself. The coordinates e = (x_i + s x_j) / sqrt 2 and o = (x_i - s x_j) / sqrt 2 of a pair x_i -> s x_j are even
(e' = e) and odd (o' = -o). A linear map commutes with the mirror if and only if it takes even to even and odd to odd
coordinates, which takes half of the products of a full matrix.
"""

import math

import torch
from torch import nn

_HALF = math.sqrt(0.5)


class SignedPermutation:
    """A mirror map: (F x)_i = sign_i x_index_i.

    Attributes:
        index: partner of each entry, shape (n,).
        sign: +1 or -1, shape (n,).
    """

    def __init__(self, index: torch.Tensor, sign: torch.Tensor) -> None:
        """Take partners, shape (n,), and signs, shape (n,).

        Raises:
            ValueError: if the image of the image is not the vector itself.
        """
        again = index[index]
        if not (
            torch.equal(again, torch.arange(len(index))) and torch.equal(sign * sign[index], torch.ones(len(sign)))
        ):
            raise ValueError("a mirror map must be its own inverse")
        self.index, self.sign = index, sign

    def __call__(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the mirror images of rows, shape (m, n)."""
        index, sign = self.index.to(rows.device), self.sign.to(rows.device)
        return rows.index_select(1, index) * sign


class EvenOdd(nn.Module):
    """The orthogonal change to even and odd coordinates of a mirror map, the even ones first.

    Attributes:
        even, odd: numbers of coordinates; entries that the mirror negates in place are odd.
        matrix: coordinates = matrix @ vector, shape (n, n).
    """

    matrix: torch.Tensor
    _columns: torch.Tensor  # of the one or two entries in each row of the matrix and of its transpose, shape (2, 2, n)
    _factors: torch.Tensor  # their values

    def __init__(self, mirror: SignedPermutation) -> None:
        """Build the coordinates of a mirror map, in the order of the first entry of each pair."""
        super().__init__()
        index, sign = mirror.index.tolist(), mirror.sign.tolist()
        even, odd = [], []
        for i, (j, s) in enumerate(zip(index, sign, strict=True)):
            if i == j:
                (even if s > 0.0 else odd).append({i: 1.0})
            elif i < j:
                even.append({i: _HALF, j: s * _HALF})
                odd.append({i: _HALF, j: -s * _HALF})
        self.even, self.odd = len(even), len(odd)
        matrix = torch.zeros(len(index), len(index))
        for row, entries in enumerate([*even, *odd]):
            for column, value in entries.items():
                matrix[row, column] = value
        columns, factors = zip(*(_sparse(one) for one in (matrix, matrix.T)), strict=True)
        # Buffers move to a device with the network; files of networks leave these out.
        self.register_buffer("matrix", matrix, persistent=False)
        self.register_buffer("_columns", torch.stack(columns), persistent=False)
        self.register_buffer("_factors", torch.stack(factors), persistent=False)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the coordinates of rows, shape (m, n): even ones first."""
        return self._product(rows, 0)

    def inverse(self, coordinates: torch.Tensor) -> torch.Tensor:
        """Return the rows of which these are the coordinates, shape (m, n)."""
        return self._product(coordinates, 1)

    def _product(self, rows: torch.Tensor, way: int) -> torch.Tensor:
        (first, second), (a, b) = self._columns[way], self._factors[way]
        return rows.index_select(1, first) * a + rows.index_select(1, second) * b


def _sparse(matrix: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return columns and values of the one or two entries in each row, (2, n); a single entry counts as two halves."""
    columns, values = [], []
    for row in matrix:
        found = row.nonzero().squeeze(1)
        ends = found[[0, -1]]
        columns.append(ends)
        values.append(row[ends] / (3 - len(found)))
    return torch.stack(columns, 1), torch.stack(values, 1)
