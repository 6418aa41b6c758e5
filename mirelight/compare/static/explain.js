// The viewer over two rungs: its pictures are those of the steps below, so that each is in the file once.
const sides = ['left', 'right'].map((side) => ({
  choice: document.getElementById(`choice-${side}`),
  picture: document.getElementById(`picture-${side}`),
  caption: document.getElementById(`caption-${side}`),
}));

const show = () => {
  for (const { choice, picture, caption } of sides) {
    picture.src = document.getElementById(`rung-${choice.value}`).src;
    picture.alt = caption.textContent = choice.selectedOptions[0].textContent;
  }
};

for (const { choice } of sides) choice.addEventListener('change', show);
for (const button of document.querySelectorAll('button[data-rung]')) {
  button.addEventListener('click', () => {
    const rung = Number(button.dataset.rung);
    [rung - 1, rung].forEach((value, k) => { sides[k].choice.value = String(value); });
    show();
    document.getElementById('viewer').scrollIntoView({ block: 'start' });
  });
}
show();
