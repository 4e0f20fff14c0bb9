// Zooming of the pictures; all else works without scripts.
document.documentElement.classList.add("zooms");
const dialog = document.querySelector("dialog");
const images = [...document.querySelectorAll(".pictures img")];
let shown = 0;

function show(index) {
  shown = (index + images.length) % images.length;
  const image = images[shown];
  dialog.querySelector("img").src = image.src;
  dialog.querySelector("p").textContent = image.alt;
  dialog.style.setProperty("--ratio", image.width / image.height);
  if (!dialog.open) dialog.showModal();
}

images.forEach((image, index) => {
  image.tabIndex = 0;
  image.addEventListener("click", () => show(index));
  image.addEventListener("keydown", (event) => { if (event.key === "Enter") show(index); });
});
dialog.addEventListener("click", () => dialog.close());
dialog.addEventListener("keydown", (event) => {
  if (event.key === "ArrowRight") show(shown + 1);
  if (event.key === "ArrowLeft") show(shown - 1);
});
